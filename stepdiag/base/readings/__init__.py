"""The table of readings: the entrance for data, and the runs of a plan.

In: CSV text or rows. Out: validated readings, their unbroken stretches and their travel. Imported
by daq and the solver.
"""
