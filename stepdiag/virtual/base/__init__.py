"""What every part of the virtual machine needs: its clock, its ports, its faults.

In: settings. Out: time, open ports, faults that happen when they should. Imported by every room of `virtual`.
"""
