"""Ports with bytes: serial lines of this computer, and lines that a terminal server holds out on
the network.

In: an address by name. Out: stamped chunks of bytes, and the message of a lost port. Imported by
`links.controls` and recording.
"""
