"""Heidenhain: .COM tables, and the .CMA file that assigns them to the axes."""
