"""Files for a control: names, numbers, lines, hashes."""
