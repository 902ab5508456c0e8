"""From a result to tables of any control: curves, profile, sampling, merging, lattice.

In: a result and a profile. Out: tables with the law by which a control applies them. Imported by
makers, profiles, safety, export.
"""
