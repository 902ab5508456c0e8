"""Sets of control files: names, numbers, lines, hashes.

In: bytes and text. Out: files that are whole or absent. Imported by every room above; independent
of all controls.
"""
