"""LinuxCNC: COMP_FILEs.

Input: tables. Output: files of this control, and tables read back from such files.
`profiles.registry` imports this package.
"""
