"""Wire formats: bytes in, samples out. No input or output, no clock, no exception on the content of
the bytes.

Every decoder offers ``feed(chunk, arrival_ns) -> Samples`` (`daq.timing.samples.Decoder`) and
``resync()``, which is called after an interruption of the stream (port reopened): it discards the
incomplete message and keeps the settings that the instrument sent.
"""
