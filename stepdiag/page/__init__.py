"""The machinist's page: a separate process with the fewest rights, and the daemon's side of it.

In: the daemon's snapshots over a pipe. Out: HTML, a live stream, downloads, and the few commands
that a person may give. Imported by `stepdiag.daemon`.
"""
