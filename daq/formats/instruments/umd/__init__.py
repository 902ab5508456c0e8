"""The decoder of the uMD boards: lines in, samples out.

In: bytes of a uMD0, uMD1 or uMD2. Out: samples and the board's properties. Imported by
`daq.formats.registry`.
"""
