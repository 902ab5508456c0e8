"""Processes, sockets, ptys, disks and brokers for system tests: each does what a test tells it, and
ends with it."""
