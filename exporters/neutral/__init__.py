"""Curves for people and other programs, as CSV.

Input: tables. Output: a CSV, and tables read back from such a file. `profiles.registry` and the
package safety import this package.
"""
