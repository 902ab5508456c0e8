"""A real LinuxCNC, headless, with its laser beside it."""
