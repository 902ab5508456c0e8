"""The parts of wire formats: cutting bytes into frames or lines, checksums, counters, columns,
units.

In: bytes. Out: frames, lines and columns of numbers. Imported by the formats of the instruments
alone.
"""
