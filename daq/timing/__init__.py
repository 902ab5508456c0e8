"""Times: the clock of the host, the clock of a stream of samples, and the stream itself.

In: stamped chunks. Out: samples with their times, and every loss of count. Imported by every room
above; depends on no survey and no file.
"""
