"""The uncertainty after the adjustment: variances from all causes, the machine's errors as a vector
with modes, Monte Carlo.

Input: a fit with its random effects. Output: covariances, budget and posterior. `planning` and
`methods` import this package.
"""
