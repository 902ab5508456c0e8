"""The result of a survey, as a Python object and as JSON.

In: numbers with uncertainties. Out: the same bytes on every machine, and the error field at any
position. The floors solver, exporters and stepdiag import this package.
"""
