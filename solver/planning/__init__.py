"""A survey before it is driven: what it will identify, how well, in what time.

In: runs. Out: forecasts and the cheapest runs that would add what is missing. Imported by methods and by `stepdiag`.
"""
