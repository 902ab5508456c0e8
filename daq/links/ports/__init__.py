"""Ports with bytes: serial lines of this computer, and lines that a terminal server holds out on the network.

In: an address by name. Out: stamped chunks of bytes, and what to say when the port is lost. Imported by `links.controls` and recording.
"""
