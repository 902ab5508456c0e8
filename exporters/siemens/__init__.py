"""SINUMERIK: EEC and CEC tables, as INI files and as loading programs.

Input: tables. Output: files of this control, and tables read back from such files.
`profiles.registry` imports this package.
"""
