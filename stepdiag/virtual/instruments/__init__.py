"""Lasers and the 4-DOF head on serial lines, with the bytes of the real instruments.

`bench` imports this package.
"""
