"""Weighted linear least squares with sparse matrices.

Input: sparse rows. Output: solutions, null spaces, covariances. The room `model` and the rooms
above import it.
"""
