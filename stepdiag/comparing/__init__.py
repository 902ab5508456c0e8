"""Comparison of several results of a machine: the changes that exceed their uncertainty.

`cli.report` and `fleet` import this package.
"""
