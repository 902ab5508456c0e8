"""The interfaces for people: commands, the machinist's page, the report, the virtual machine, the
demo.

No other package imports this one; programs use `stepdiag.api`.
"""
