"""Verdicts: whether a table, or a lattice, is the table that the result requests."""
