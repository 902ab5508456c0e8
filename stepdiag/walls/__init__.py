"""Restrictions (walls) that a process puts on itself before it accepts its first foreign client.

In: the files that the process reads, and the port that it calls. Out: the rights that the kernel
could not remove. `page`, `publish` and `fleet` import this package.
"""
