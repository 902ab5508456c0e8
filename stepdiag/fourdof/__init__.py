"""The 4-DOF head: its runs, its samples, its commissioning.

In: logs or a port. Out: straightness and angles of an axis, calibration values. `completion`,
`head` and `cli` import this package.
"""
