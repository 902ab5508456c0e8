"""The methods by name: the estimator, and the closed form as printed and as corrected.

In: readings. Out: a result. Imported by `daq`, `stepdiag`.
"""
