"""Counts that a benchmark prints for many machines and a test holds for few."""
