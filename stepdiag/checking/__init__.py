"""The check of laser and PLC before a survey: their live data and their faults.

`cli.check` imports this package.
"""
