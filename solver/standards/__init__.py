"""Figures of the standards: ISO 230-2 and 230-6, and straightness.

Input: arrays. Output: figures under the names of the standards. Every other package of the solver
may import this package, which imports none of them.
"""
