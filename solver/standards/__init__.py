"""Figures of the standards: ISO 230-2 and 230-6, and straightness.

In: plain arrays. Out: figures with the names of the standards. Imported by every room above;
imports none.
"""
