"""How things look on a terminal: tables, progress, safe text, exit codes.

In: values. Out: lines. Imported by the rooms that print, and by `cli`.
"""
