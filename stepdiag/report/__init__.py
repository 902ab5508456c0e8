"""The report a service engineer hands over.

In: a result, and the readings, files and logs that belong to it. Out: one HTML file that needs nothing else, its figures as CSV, a PDF.
Imported by `stepdiag.daemon` and `stepdiag.cli`.
"""
