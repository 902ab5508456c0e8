"""Ports that deliver bytes: serial lines of this computer, and lines that a terminal server offers
on the network.

Input: the address of a port by name. Output: stamped chunks of bytes, and the message of a lost
port. Imported by `links.controls` and recording.
"""
