"""The result of a survey as a Python object and as JSON.

The floors solver, exporters and stepdiag import this package.
"""
