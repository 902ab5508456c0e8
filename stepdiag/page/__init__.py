"""The machinist's page: a separate process with the fewest rights, and the part of the daemon that
serves this process.

In: the daemon's snapshots over a pipe. Out: HTML, a live stream, downloads, and the few commands
that a person may give. `stepdiag.daemon` imports this package.
"""
