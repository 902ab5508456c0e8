"""Files as such: names, numbers, settings, hashes, atomic writing.

In: bytes and text. Out: files that are whole or absent. Imported by every room above; knows no control.
"""
