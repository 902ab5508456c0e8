"""Beckhoff and ISG: volumetric CSV and parameter lists.

In: tables. Out: files of this control, and tables read back from them. Imported by
`profiles.registry`.
"""
