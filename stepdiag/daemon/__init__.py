"""The parts of the daemon that a person sees: journal, page, metrics, the state of a survey on
disk, replay.

In: a survey file or its folder. Out: a running service, its journal, a replay of its survey. `cli`
imports this package.
"""
