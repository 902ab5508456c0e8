"""Is the bench ready: laser and PLC live, and what is wrong with them.

In: a survey file and open links. Out: observations and a diagnosis. Imported by `cli.check`.
"""
