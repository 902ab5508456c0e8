"""Whether the bench is ready: laser and PLC live, and the faults of both.

In: a survey file and open links. Out: observations and a diagnosis. Imported by `cli.check`.
"""
