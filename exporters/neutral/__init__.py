"""Curves for people and other programs, as CSV.

In: tables. Out: a CSV and the same tables read back. Imported by `profiles.registry` and safety.
"""
