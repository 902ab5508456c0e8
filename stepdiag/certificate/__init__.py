"""The digital calibration certificate: a result as a DCC of PTB, and the check of a DCC against its
logs.

In: a result, its files, and a laboratory's file. Out: XML whose figures another program can compute
again. `cli` imports this package.
"""
