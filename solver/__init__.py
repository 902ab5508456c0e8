"""The mathematics: numpy arrays in, numpy arrays out; no files, no clocks, no logging.

In: readings. Out: a result with its uncertainty and its unidentified values. Rooms, from the
lowest: standards, readings, result, linear, model, adjustment, fourdof, uncertainty, planning,
methods. Imported by every other floor.
"""
