"""Is a table, or a lattice, the one that the result asks for? One verdict each.

In: a result and the tables that act before and after loading. Out: a word and a sentence for each. Imported by `exporters.safety` alone.
"""
