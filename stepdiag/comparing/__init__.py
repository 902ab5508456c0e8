"""Two results or many: what changed by more than its uncertainty.

In: results. Out: changes and trends. Imported by `cli.report`.
"""
