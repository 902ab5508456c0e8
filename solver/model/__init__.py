"""The linear model: which unknowns a survey has and how each reading depends on them.

In: readings and known angles. Out: a layout, rows of the design, the quantities asked for. Imported
by adjustment and above.
"""
