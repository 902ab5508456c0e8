"""The machine's profile as a file, its template, and the controls by name.

In: TOML. Out: a `Profile` and its `Controller`. Imported by safety and export.
"""
