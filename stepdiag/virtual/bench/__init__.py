"""The bench: all of it built from one settings file and run.

In: a TOML file. Out: a machine, a PLC and lasers that speak. Imported by `__main__`, tests and the demo.
"""
