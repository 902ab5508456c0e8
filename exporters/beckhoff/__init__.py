"""Beckhoff and ISG: volumetric CSV and parameter lists.

In: tables. Out: files of this control, and tables read back from such files. Imported by
`profiles.registry`.
"""
