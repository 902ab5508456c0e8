"""Machines' controls, each by its own protocol behind a common interface: Modbus, S7, LSV2.

In: the ranges to read, and the period. Out: stamped blocks of registers, or the reason for none.
Imported by recording, `check` and `setup`.
"""
