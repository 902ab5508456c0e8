"""The bench: machine, PLC and lasers, built from one settings file (TOML) and run.

`__main__`, tests and the demo import this package.
"""
