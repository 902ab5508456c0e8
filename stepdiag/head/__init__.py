"""The 4-DOF head on the command line: the sources of its samples and the display of its results.

In: a port, logs or files. Out: tables and drawings. `cli.fourdof` imports this package.
"""
