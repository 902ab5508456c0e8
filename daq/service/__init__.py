"""The daemon, which connects links, session and recorder, and leaves computations to other
processes.

In: a survey file. Out: status, logs, and results made by child processes. Imported by `stepdiag`
only.
"""
