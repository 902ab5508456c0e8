"""The report a service engineer hands over.

In: a result, and its readings, files and logs. Out: one self-contained HTML file, its figures as
CSV, a PDF. Imported by `stepdiag.daemon` and `stepdiag.cli`.
"""
