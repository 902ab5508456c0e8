"""A whole survey on a virtual machine, from recording to verification.

In: a seed. Out: a folder with survey, logs, result, compensation files and the improvement.
`cli.demo` imports this package.
"""
