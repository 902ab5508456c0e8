"""Wire formats: bytes in, samples out. No input or output, no clock, no exception on the content of
the bytes.

Every decoder offers ``feed(chunk, arrival_ns) -> Samples`` (`daq.timing.samples.Decoder`) and
``resync()``, to be called when the stream was interrupted (port reopened): what was half received
is forgotten, what the instrument sent of itself is kept.
"""
