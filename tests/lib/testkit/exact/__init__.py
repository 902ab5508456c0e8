"""Exact machines, controls and optics as laws of their own: nothing of the solver or the exporters
is used to make them."""
