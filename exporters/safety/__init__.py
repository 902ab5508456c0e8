"""Conditions for a file before it reaches a control, and its effect there.

In: tables, profile, files. Out: refusals, restore files, verdicts, the sign test. Imported by
export and `stepdiag`.
"""
