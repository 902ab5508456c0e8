"""The proof run after loading: a diagonal and a line, judged table by table.

In: readings of the survey and of the proof run, the active tables. Out: a verdict per table, and
keep or restore. Imported by `stepdiag` alone.
"""
