"""The survey file: what a person wrote, checked.

In: TOML and the files it names. Out: a `Survey`, or the field that is wrong. Imported by every room
above; opens no port.
"""
