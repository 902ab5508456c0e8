"""The survey file: its text is read and checked.

In: TOML and the files that the TOML names. Out: a `Survey`, or the name of the wrong field.
Imported by every room above; opens no port.
"""
