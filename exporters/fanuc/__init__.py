"""Fanuc: pitch error and straightness compensation parameters.

Input: tables. Output: files of this control, and tables read back from such files.
`profiles.registry` imports this package.
"""
