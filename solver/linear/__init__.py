"""Weighted linear least squares with structure.

In: sparse rows. Out: solutions, null spaces, covariances. Imported by model and above; contains
nothing of machines.
"""
