"""Files as the operating system sees them: hidden places to write in, locks, what is on the disk,
and what differs between systems.

In: paths and bytes. Out: files that appear whole. Imported by every floor that writes.
"""
