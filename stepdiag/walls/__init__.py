"""The walls of a process around itself before its first foreign client.

In: the files it reads, the port it calls. Out: the rights that the kernel leaves. Imported by
`page`, `publish` and `fleet`.
"""
