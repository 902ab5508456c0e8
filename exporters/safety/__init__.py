"""What must hold before a file reaches a control, and what it will do there.

In: tables, profile, files. Out: refusals, restore files, verdicts, the sign test. Imported by export and `stepdiag`.
"""
