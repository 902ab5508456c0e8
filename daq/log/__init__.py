"""The log: one MCAP file per pass, with the raw bytes first.

In: events. Out: files that survive the end of the process, and the events read from these files.
Imported by replay, recording and service.
"""
