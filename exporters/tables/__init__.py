"""The tables of any control from a result: curves, profile, sampling, merging, lattice.

Input: a result and a profile. Output: tables, each with the law by which a control applies it. The
packages of the makers, profiles, safety and export import this package.
"""
