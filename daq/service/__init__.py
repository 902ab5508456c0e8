"""The daemon: it holds links, session and recorder together and has computed what is computed
elsewhere.

In: a survey file. Out: status, logs, and results made by child processes. Imported by `stepdiag`
only.
"""
