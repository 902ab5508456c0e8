"""Virtual controls: each loads compensation files and applies them by the law of its real control.

In: files. Out: the control's addition to a command. Imported by bench.
"""
