"""Sets of control files: names, numbers, lines, hashes.

Input: bytes and text. Output: files that are complete or absent. Every other package of the
exporters imports this package, which depends on no control.
"""
