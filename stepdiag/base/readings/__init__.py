"""The table of readings, which is the input of the solver, and the plan of a survey.

The floors daq and solver import this package.
"""
