"""Checks of the files before loading, and the effect of the files in the control."""
