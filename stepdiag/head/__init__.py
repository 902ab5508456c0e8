"""The 4-DOF head for a person: where its samples come from and how its results look.

In: a port, logs or files. Out: tables and drawings. Imported by `cli.fourdof`.
"""
