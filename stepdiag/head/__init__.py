"""The 4-DOF head for a person: the sources of its samples and the display of its results.

In: a port, logs or files. Out: tables and drawings. Imported by `cli.fourdof`.
"""
