"""The whole job on a virtual machine.

In: a seed. Out: a folder with survey, logs, result, files and the improvement. Imported by
`cli.demo`.
"""
