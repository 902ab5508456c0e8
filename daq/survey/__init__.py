"""The survey file: the text of a person, checked.

In: In: TOML and the files that it names. Out: a `Survey`, or the name of the wrong field. Imported
by every room above; opens no port.
"""
