"""The mathematics: numpy arrays in, numpy arrays out; no files, no clocks, no logging.

In: readings. Out: a result with its uncertainty and what it does not identify. Rooms, lowest first:
standards, readings, result, linear, model, adjustment, fourdof, uncertainty, planning, methods.
Imported by every other floor.
"""
