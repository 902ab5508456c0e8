"""Cases of the references of the exporters: what is done with a made-up result, as plain data that
a record can hold.

Inputs are written with few decimals and made with the four basic operations alone, so that every
processor begins with the same numbers; none lies near the middle between two units of a table, so
that what is rounded does not hang on the last digit.
"""
