"""Findings about machine, sensors and streams that do not come from the stops.

In: registers, air, streams. Out: findings. Imported by the rest of `capture`, and by the rooms that
list unchecked facts.
"""
