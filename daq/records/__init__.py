"""Recorded events, and the status of the daemon.

In: nothing. Out: events (chunks, register blocks, links) and the daemon's status, as immutable
values. Imported by every room of `daq`.
"""
