"""The digital calibration certificate (DCC of PTB) of a result, and its verification against the
logs.

`cli` imports this package.
"""
