"""A virtual ISG kernel with volumetric compensation: ISG_CSV files (TF5280, 296429067), values in
mm and rad (296426379).

An error that is a number has one row without an argument; a function has a row per position of its
axis; a line ``#`` begins the next block, whose first row contains the column names.
"""

import numpy as np

from stepdiag.virtual.control.chain import SQUARENESS_TURNS, ChainTable, Nodes


def load_volumetric(
    text: str, *, chain: str = "FXYZ", carries: bool = False, negate: str = ""
) -> ChainTable:
    """Return the correction by a volumetric file on a machine with this chain. Raises ValueError
    for an unknown column."""
    functions: dict[str, Nodes] = {}
    squareness: dict[str, float] = {}
    for block in _blocks(text):
        head, rows = block[0], np.array([[float(cell) for cell in row] for row in block[1:]])
        if head[0] in ("X", "Y", "Z"):
            for column, name in enumerate(head[1:], start=1):
                if name[0] != "E" or name[2] != head[0]:
                    raise ValueError(f"{name}: expected a function of {head[0]}")
                functions[name] = (rows[:, 0], rows[:, column])
            continue
        for name, value in zip(head, rows[0], strict=True):
            if name not in SQUARENESS_TURNS:
                raise ValueError(f"{name}: expected a squareness")
            squareness[name] = float(value)
    return ChainTable(
        chain=chain,
        functions=functions,
        squareness_rad=squareness,
        carries=carries,
        negated=negate,
    )


def _blocks(text: str) -> list[list[list[str]]]:
    blocks: list[list[list[str]]] = [[]]
    for line in text.splitlines():
        cells = line.split("//")[0].split()
        if cells and cells[0] == "#":
            blocks.append([])
        elif cells:
            blocks[-1].append(cells)
    return blocks
