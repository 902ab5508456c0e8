"""The file of a machine's profile, the template for such files, and the controls by name.

Input: the TOML text of a profile. Output: a `Profile` and its `Controller`. The packages safety and
export import this package.
"""
