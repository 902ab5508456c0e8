"""Restrictions (walls) that a process sets on itself before it accepts its first client.

`page`, `publish` and `fleet` import this package.
"""
