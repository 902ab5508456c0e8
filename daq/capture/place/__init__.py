"""Where the machine stood: which pass, and which stop of it.

In: dwells, positions and the laser's count. Out: a stop of the route, or why none. Imported by the rest of `capture`.
"""
