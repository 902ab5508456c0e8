"""The 4-DOF head alone: its runs, its record, its commissioning.

In: logs or a port. Out: straightness and angles of an axis, calibration values. Imported by
completion, head and cli.
"""
