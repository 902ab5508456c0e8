"""The test whether a table, or a lattice, is the one that the result requests; each gets a verdict.

In: a result and the active tables before and after loading. Out: a word and a sentence for each.
Imported by `exporters.safety` alone.
"""
