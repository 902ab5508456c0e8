"""The linear model: the unknowns of a survey and the dependence of each reading on them.

Input: readings and known angles. Output: a layout, the rows of the design matrix, the requested
quantities. The package `adjustment` and the packages above it import this package.
"""
