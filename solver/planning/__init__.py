"""A survey before it is driven: the quantities that it identifies, their uncertainty, and the time
of the survey.

Input: planned runs. Output: forecasts, and the cheapest runs that identify the missing quantities.
The package `methods` and `stepdiag` import this package.
"""
