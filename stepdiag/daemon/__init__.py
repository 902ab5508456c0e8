"""The parts of the daemon that a person sees: journal, page, metrics, the state of a survey,
replay.

`cli` imports this package.
"""
