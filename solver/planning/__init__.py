"""A survey before it is driven: the quantities that it identifies, their uncertainty, and the time
of the survey.

Input: planned runs. Output: forecasts, and the runs of least time that identify the missing
quantities. `methods` and `stepdiag` import this package.
"""
