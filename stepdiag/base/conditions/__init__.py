"""The refractive index of air, the thermal expansion of the axes, and the assumed sizes of a
machine's errors.

The floors daq and solver import this package.
"""
