"""The program that drives a survey: setups, sequence, moves and dwells.

In: a plan. Out: the commanded position at any time. `plc`, `instruments` and `bench` import this
package.
"""
