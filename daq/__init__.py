"""The recording: from the bytes of the instruments to the stops.

In: bytes of a laser and registers of a machine. Out: logs, passes, readings. Rooms, from the
lowest: records, timing, formats, links, survey, capture, passes, log, replay, recording, head,
service. Imported by `stepdiag` only.
"""
