"""The machinist's page."""
