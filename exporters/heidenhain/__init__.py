"""Heidenhain: COM files, and the table that names the COM files.

In: tables. Out: files of this control, and tables read back from them. Imported by
`profiles.registry`.
"""
