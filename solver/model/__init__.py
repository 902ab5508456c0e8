"""The linear model: the unknowns of a survey and the dependence of each reading on them.

Input: readings and known angles. Output: a layout, the rows of the design matrix, the reported
quantities. The room `adjustment` and the rooms above import it.
"""
