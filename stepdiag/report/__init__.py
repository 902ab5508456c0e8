"""The report for the customer: one self-contained HTML file, its figures as CSV, a PDF.

`stepdiag.daemon` and `stepdiag.cli` import this package.
"""
