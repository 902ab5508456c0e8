"""Compensation tables for any control, computed from a result and the profile of a machine."""
