"""A virtual iTNC 530: .COM tables, and KinematicsComp with the rows of a kinematics table (HSCI
technical manual pp. 666-686).

Without rows in the kinematics table, a .COM table acts only by its axis columns: the column Z of
the table of X is Z = F(X). The rows of the kinematics table are in the order from the tool to the
work, and the rows of an axis come before the row ``MachAxis`` of this axis. The rows of an axis
contain the columns C1 to C6 of the axis's table. Angles are in degrees.
"""

import re
from collections.abc import Mapping

import numpy as np

from stepdiag.virtual.control.chain import ChainTable, Nodes
from stepdiag.virtual.physics.error_functions import Array

_BEGIN = re.compile(r"BEGIN \S+\s+DATUM:(\S+) DISTANCE:(\S+)")
_ROW = re.compile(r"Trans\s+([XYZABC])\s+\S*\.\.(C[1-6])")
_MACHINE_AXIS = re.compile(r"MachAxis\s+(\S+)")


def load_tables(
    tables: Mapping[str, str], lines: str = "", *, axis_names: Mapping[str, str]
) -> ChainTable:
    """Return the effect of .COM files. The keys of ``tables`` are the axis names in the .CMA file,
    the values are the texts of the .COM files. ``lines`` are the rows of the kinematics table.

    ``axis_names`` gives X, Y or Z for each name of an axis. Without rows, the chain has no effect
    and no angle is compensated.
    """
    functions: dict[str, Nodes] = {}
    columns = {axis_names[name]: _columns(text) for name, text in tables.items()}
    for letter, table in columns.items():
        position = table["position"]
        for name, output in axis_names.items():
            if table.get(name, np.zeros(1)).any():
                functions[f"E{output}{letter}"] = (position, table[name])
    order, waiting = "", list[tuple[str, str]]()
    for line in lines.splitlines():
        if line.startswith("#"):
            continue
        if row := _ROW.search(line):
            waiting.append((row[1], row[2]))
        elif machine_axis := _MACHINE_AXIS.search(line):
            letter = axis_names[machine_axis[1]]
            order = letter + order
            for component, column in waiting:
                values = columns[letter][column]
                functions[f"E{component}{letter}"] = (
                    columns[letter]["position"],
                    np.radians(values) if component in "ABC" else values,
                )
            waiting = []
    return ChainTable(chain=f"F{order or 'XYZ'}", functions=functions, before_travel=True)


def _columns(text: str) -> dict[str, Array]:
    first, heading, *rows = [line for line in text.splitlines() if line.strip()]
    begin = _BEGIN.match(first)
    if begin is None or rows[-1] != "[END]":
        raise ValueError(f"table: expected DATUM and DISTANCE, and an end, found {first!r}")
    values = np.array([[float(cell) for cell in row.split()] for row in rows[:-1]])
    table = dict(zip(heading.split(), values.T, strict=True))
    return {**table, "position": float(begin[1]) + float(begin[2]) * table["NR"]}
