"""Writing of files: hidden folders, locks, syncing to the disk, and the differences between
operating systems.

Every floor that writes files imports this package.
"""
