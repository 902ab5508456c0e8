"""Names of the axes, the setups and the errors of two axes, and the numbers of the setups in a
program (contract 2)."""

from collections.abc import Mapping

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
PRODUCTS: Mapping[str, tuple[int, tuple[int, ...]]] = {
    **{
        f"{'XYZ'[component]}({'xyz'[a]}{'xyz'[b]})": (component, (a, b))
        for component in range(3)
        for a, b in ((0, 1), (0, 2), (1, 2))
    },
    "Z(yyz)": (2, (1, 1, 2)),
}
"""Errors that depend on two axes, by name: the component of the error, and the axes whose shares of
the travel are multiplied. Each value is the error at the far corner in um. Examples: an axis bends
when another axis carries it further out, or a ram sags."""
