"""From the wires to the stops: links, wire formats, clocks, synchroniser, log, replay, daemon."""
