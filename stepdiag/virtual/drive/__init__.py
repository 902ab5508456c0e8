"""The program that drives a survey: setups, sequence, moves and dwells.

`plc`, `instruments` and `bench` import this package.
"""
