"""A module per instrument or family of instruments: from its bytes to samples.

In: chunks of bytes and the time of their arrival. Out: samples, or requests for polled instruments.
Imported by `formats.registry` and by the readers of a survey file.
"""
