"""Controls that load compensation files, each by its own law.

In: files. Out: what the control adds to a command. Imported by bench.
"""
