"""The demo: a whole survey on a virtual machine, from recording to verification.

`cli.demo` imports this package.
"""
