"""The uMD boards: their lines to samples.

In: bytes of a uMD0, uMD1 or uMD2. Out: samples and the board's properties. Imported by
`daq.formats.registry`.
"""
