"""What people touch: commands, the machinist's page, the report, the virtual machine, the demo.

In: what a person types, clicks or puts into a file. Out: words, pictures, exit codes. Imported by nobody; programs use `stepdiag.api`.
"""
