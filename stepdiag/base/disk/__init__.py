"""Files as the operating system sees them: hidden folders for writing, locks, syncing to the disk,
and the differences between systems.

In: paths and bytes. Out: files that appear complete. Every floor that writes files imports this
package.
"""
