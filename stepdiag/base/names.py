"""Names of the axes and setups, and the numbers of the setups in a program (contract 2)."""

AXES = ("x", "y", "z")
BODY_DIAGONALS = ("ppp", "npp", "pnp", "ppn")
LINEAR_RUNS = ("linear-x", "linear-y", "linear-z")
FOURDOF_RUNS = ("fourdof-x", "fourdof-y", "fourdof-z")
SETUP_NUMBERS = {
    1: "ppp",
    2: "npp",
    3: "pnp",
    4: "ppn",
    11: "linear-x",
    12: "linear-y",
    13: "linear-z",
    21: "fourdof-x",
    22: "fourdof-y",
    23: "fourdof-z",
}
"""The setup of each number of the machine's ``setup`` register (contract 2)."""
