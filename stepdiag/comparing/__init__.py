"""Comparison of two or more results of a machine: the changes that exceed their uncertainty.

In: results. Out: changes and trends. `cli.report` imports this package.
"""
