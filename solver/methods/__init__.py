"""The methods by name: the estimator, and the closed form of Wang 2000, as printed and corrected.

Input: the readings of a survey. Output: a result. `stepdiag` imports this package.
"""
