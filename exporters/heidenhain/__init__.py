"""Heidenhain: COM files, and the table that names the COM files.

Input: tables. Output: files of this control, and tables read back from such files.
`profiles.registry` imports this package.
"""
