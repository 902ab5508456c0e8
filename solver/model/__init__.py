"""The linear model: the unknowns of a survey and the dependence of each reading on them.

In: readings and known angles. Out: a layout, rows of the design, the requested quantities. Imported
by adjustment and above.
"""
