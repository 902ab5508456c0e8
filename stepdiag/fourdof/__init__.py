"""The 4-DOF head: its runs, its samples, its commissioning.

`completion`, `head` and `cli` import this package.
"""
