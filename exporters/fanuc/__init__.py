"""Fanuc: pitch error, inclination and straightness compensation in punch files."""
