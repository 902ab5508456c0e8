"""The mathematics: numpy arrays in, numpy arrays out; no files, no clocks, no logging.

Input: the readings of a survey. Output: a result with its uncertainties, and the names of the
values that the readings do not identify. `stepdiag` imports this package.
"""
