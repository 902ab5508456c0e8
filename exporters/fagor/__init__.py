"""Fagor: leadscrew compensation tables."""
