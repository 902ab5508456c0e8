"""Files as the operating system sees them: hidden places for writing, locks, syncing to the disk,
and the differences between systems.

In: paths and bytes. Out: files that appear complete. Imported by every floor that writes.
"""
