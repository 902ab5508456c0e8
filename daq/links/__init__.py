"""The only code that opens a port or a socket: serial lines, controls, and their reconnection.

In: addresses and settings. Out: stamped bytes and register blocks, and `connected`, `silent`,
`lost` with the reason. Imported by survey, recording and head, and by checking, daemon and cli of
`stepdiag`.
"""
