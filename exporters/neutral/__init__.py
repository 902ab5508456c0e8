"""Error curves as CSV, and results in the Etalon Exchange format, for people and other programs."""
