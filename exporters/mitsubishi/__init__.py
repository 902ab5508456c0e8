"""Mitsubishi: machine error compensation parameters.

In: tables. Out: files of this control, and tables read back from them. Imported by
`profiles.registry`.
"""
