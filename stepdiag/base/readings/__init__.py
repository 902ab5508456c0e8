"""The table of readings, by which all measured data enter the solver, and the runs of a plan.

In: CSV text or rows. Out: checked readings, the stretches of unbroken laser count, and the travel.
The floors daq and solver import this package.
"""
