"""The only code that opens a port or a socket: serial lines, controls, and an object that
reconnects both.

In: addresses and settings. Out: stamped bytes and register blocks, and `connected`, `silent`,
`lost` with the reason. Imported by survey, recording, head and, of `stepdiag`, checking, daemon and
cli.
"""
