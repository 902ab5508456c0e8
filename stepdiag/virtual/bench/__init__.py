"""The bench: built completely from one settings file and run.

In: a TOML file. Out: a machine, a PLC and lasers that send. `__main__`, tests and the demo import
this package.
"""
