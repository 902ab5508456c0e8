"""The report a service engineer hands over."""
