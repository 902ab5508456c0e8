"""The common base of the virtual machine's parts: its clock, its ports, its faults.

In: settings. Out: time, open ports, faults at their times. Every package of `virtual` imports this
package.
"""
