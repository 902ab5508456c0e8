"""The log: one MCAP file a pass, raw bytes first.

In: events. Out: files that survive the end of the process, and on reading the same events again.
Imported by replay, recording and service.
"""
