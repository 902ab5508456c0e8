"""Is a table, or a lattice, the one requested by the result? A verdict each.

In: a result and the active tables before and after loading. Out: a word and a sentence for each.
Imported by `exporters.safety` alone.
"""
