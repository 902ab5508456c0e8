"""One module an instrument or family of instruments: from its bytes to samples.

In: chunks of bytes and the time of their arrival. Out: samples, or requests for those that must be asked. Imported by `formats.registry`
and by those who read a survey file.
"""
