"""The place of the machine: its pass, and the stop within it.

In: dwells, positions and the laser's count. Out: a stop of the route, or the reason for none.
Imported by the rest of `capture`.
"""
