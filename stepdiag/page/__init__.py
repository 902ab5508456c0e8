"""The machinist's page: a separate process with the fewest rights, and the part of the daemon that
serves this process.

`stepdiag.daemon` imports this package.
"""
