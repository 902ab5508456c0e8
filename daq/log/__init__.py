"""The log: one MCAP file a pass, raw bytes first.

In: events. Out: files that survive a kill, and the same events again. Imported by replay, recording
and service.
"""
