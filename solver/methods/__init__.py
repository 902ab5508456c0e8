"""The methods by name: the estimator, and the closed form as printed and as corrected.

Input: the readings of a survey. Output: a result. `stepdiag` imports this package.
"""
