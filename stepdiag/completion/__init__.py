"""The end of a survey: its logs replayed, solved and exported; and the weaknesses of its plan,
known before the drive.

In: logs, or a survey file. Out: result, files and the verdict. Combines daq, solver and exporters;
daemon, report, head, checking, fleet and cli import this package.
"""
