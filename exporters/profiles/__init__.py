"""The profile of a machine, the template for profiles, and the list of known controls."""
