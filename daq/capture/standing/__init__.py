"""The machine's standstills, and the laser's readings during them.

In: polls of the machine and samples of the laser. Out: dwells, standstills, the mean of a window
and its uncertainty. Imported by the rest of `capture`.
"""
