"""Conditions for a file before it reaches a control, and the effect of the file in the control.

In: tables, profile, files. Out: refusals, restore files, verdicts, the sign test. Imported by
export and `stepdiag`.
"""
