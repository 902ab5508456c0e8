"""Survey files for tests: the least that is accepted."""

SMALLEST = """
[survey]
name = "s"
machine = "m"
[volume]
size_mm = [500, 400, 300]
increments = 10
[laser]
format = "umd"
port = "/dev/ttyUSB0"
"""
