"""The common code of the live run and the replay: from events to captured stops.

In: events in the order of their recording, and the log's start record. Out: stops, findings, the
end of a pass. Imported by replay and recording; uses no files, no ports and no clock.
"""
