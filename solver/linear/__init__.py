"""Weighted linear least squares with sparse matrices.

Input: sparse rows. Output: solutions, null spaces, covariances. All other packages of the solver
except `standards` and `fourdof` import this package.
"""
