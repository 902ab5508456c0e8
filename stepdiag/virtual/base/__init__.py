"""The common base of the virtual machine's parts: its clock, its ports, its faults.

Every package of `virtual` imports this package.
"""
