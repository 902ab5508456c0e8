"""Findings about machine, sensors and streams that do not come from the stops.

In: registers, air, streams. Out: findings. Imported by the rest of `capture`, by `passes` and
`recording`, and by the packages that report signals without a check.
"""
