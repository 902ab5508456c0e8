"""The uMD boards: their lines to samples.

In: bytes of a uMD0, uMD1 or uMD2. Out: samples and what the board says of itself. Imported by `daq.formats.registry`.
"""
