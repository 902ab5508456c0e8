"""A survey before its drive: its identified quantities, their uncertainty, its time.

In: runs. Out: forecasts and the cheapest runs for the missing quantities. Imported by methods and
by `stepdiag`.
"""
