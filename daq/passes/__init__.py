"""From captured stops to passes and to readings.

In: stops of one or several logs. Out: complete passes, passes to drive again with the reason, and
the solver's table. Imported by log readers, recording and service.
"""
