"""Machines' controls, each by its own protocol behind one way: Modbus, S7, LSV2.

In: what to ask, and how often. Out: stamped blocks of registers, or why there are none. Imported by recording, `check` and `setup`.
"""
