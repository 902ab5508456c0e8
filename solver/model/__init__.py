"""The linear model: the unknowns of a survey and the dependence of each reading on them.

Input: readings and known angles. Output: a layout, the rows of the design matrix, the reported
quantities. `adjustment`, `uncertainty`, `planning`, `methods` and `stepdiag` import this package.
"""
