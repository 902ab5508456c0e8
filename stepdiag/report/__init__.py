"""The report that a service engineer hands over to the customer.

In: a result, and its readings, files and logs. Out: one self-contained HTML file, its figures as
CSV, a PDF. `stepdiag.daemon` and `stepdiag.cli` import this package.
"""
