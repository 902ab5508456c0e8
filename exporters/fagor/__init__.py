"""Fagor: leadscrew and cross compensation tables.

In: tables. Out: files of this control, and tables read back from them. Imported by
`profiles.registry`.
"""
