"""Mitsubishi: machine error compensation parameters."""
