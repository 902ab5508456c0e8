"""Controls of machines behind a common interface; the protocols are Modbus, S7 and LSV2.

In: the ranges to read, and the period. Out: stamped blocks of registers, or the reason why there is
no block. Imported by recording, `check` and `setup`.
"""
