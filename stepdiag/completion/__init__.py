"""The completion of a survey: its logs are replayed, solved and exported; also the weaknesses of
its plan.

The package combines daq, solver and exporters; daemon, report, head, checking, fleet and cli import
it.
"""
