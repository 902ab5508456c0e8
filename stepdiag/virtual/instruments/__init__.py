"""Lasers and the 4-DOF head on serial lines.

In: the optical path. Out: bytes as the instrument would send them. `bench` imports this package.
"""
