"""Output on a terminal: tables, progress, safe text, exit codes.

`cli` and the packages that print import this package.
"""
