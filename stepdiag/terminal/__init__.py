"""Output on a terminal: tables, progress, safe text, exit codes.

In: values. Out: lines. Imported by the printing rooms and by `cli`.
"""
