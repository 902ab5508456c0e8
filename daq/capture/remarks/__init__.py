"""Remarks of machine, sensors and streams beside the stops, in words for the operator.

In: registers, air, streams. Out: findings. Imported by the rest of `capture`, and by the rooms that
list unchecked facts.
"""
