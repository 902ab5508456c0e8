"""The uncertainty beyond the residuals: sources, their propagation, Monte Carlo.

In: an adjustment and a list of sources. Out: a budget for every quantity. Imported by planning and methods.
"""
