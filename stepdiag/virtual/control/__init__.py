"""Controls that load compensation files, each by its own law.

In: files. Out: the control's addition to a command. Imported by bench.
"""
