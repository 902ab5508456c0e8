"""Output on a terminal: tables, progress, safe text, exit codes.

In: values. Out: lines. `cli` and the packages that print import this package.
"""
