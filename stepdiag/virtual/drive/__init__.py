"""The program that drives a survey: setups, sequence, moves and dwells.

In: a plan. Out: where the machine is told to be at any time. Imported by plc, instruments and bench.
"""
