"""The 4-DOF head on the command line: sources of samples, and display of results.

`cli.fourdof` imports this package.
"""
