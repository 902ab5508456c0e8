"""The walls that a process sets up around itself before it meets the first stranger.

In: what of the disk it reads, which port it calls. Out: what the kernel leaves open. Imported by `page`, `publish` and `fleet`.
"""
