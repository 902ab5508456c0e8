"""The end of a survey: its logs replayed, solved and exported; and what its plan can show before it
is driven.

In: logs, or a survey file. Out: result, files and the verdict. Puts daq, solver and exporters
together; imported by daemon, report, head, checking, fleet and cli.
"""
