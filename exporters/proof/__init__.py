"""The proof run after loading: one diagonal and one line, judged table by table.

In: readings of the survey and of the proof run, the tables that act. Out: a verdict for each table, and keep or restore.
Imported by `stepdiag` alone.
"""
