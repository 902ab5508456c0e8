"""SINUMERIK: EEC and CEC tables, as INI files and as loading programs.

In: tables. Out: files of this control, and tables read back from them. Imported by
`profiles.registry`.
"""
