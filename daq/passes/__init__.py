"""From captured stops to passes and to readings.

In: stops of one or several logs. Out: which passes are whole, which must be driven again and why;
the solver's table. Imported by log readers, recording and service.
"""
