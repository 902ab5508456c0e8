"""Wire formats: bytes in, samples out. Decoders read no port and no clock, and no content of the
bytes raises an exception.

Every decoder offers ``feed(chunk, arrival_ns) -> Samples`` (`daq.timing.samples.Decoder`) and
``resync()``, which is called after an interruption of the stream (port reopened). ``resync()``
discards the incomplete message and keeps the settings that the instrument sent.
"""
