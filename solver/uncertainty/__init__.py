"""The knowledge after the adjustment: variances with every cause, the machine as a vector with its
modes, Monte Carlo.

In: a fit with its causes. Out: covariances, budget and posterior. Imported by planning and methods.
"""
