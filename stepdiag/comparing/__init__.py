"""Two results or more: the changes beyond their uncertainty.

In: results. Out: changes and trends. Imported by `cli.report`.
"""
