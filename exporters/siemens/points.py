"""Text of the points and the grid of one table, which EEC and CEC share (function manual K3 pp.
237-264).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.siemens.ini import Assignment, grid_mm
from stepdiag.exporters.tables.tables import Table, require_rising


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """The points of a table: ``value_um`` at ``position_mm``, both of shape (N,), with the
    resolution ``quantum_um``.
    """

    position_mm: Vector
    value_um: Vector
    quantum_um: float


def point_lines(table: Table, variable: str, decimals: int, points: int) -> list[str]:
    """Return the assignments of all points in mm, with zeros up to ``points``. ``variable``
    contains ``{}`` in place of the point number.

    Points that are not written keep their old values (K3, CAUTION), so surplus points are written
    as 0.
    """
    values = [float(value) / 1000 for value in table.value_um]
    values += [0.0] * (points - len(values))
    return [
        f"${variable.format(number)}={fixed(value, decimals)}"
        for number, value in enumerate(values)
    ]


def grid_lines(table: Table, variable: str, place: str) -> list[str]:
    first, second, last = (float(table.position_mm[index]) for index in (0, 1, -1))
    named = (("STEP", second - first), ("MIN", first), ("MAX", last))
    return [f"${variable}_{name}[{place}]={shortest(value)}" for name, value in named]


def read_points(
    written: Mapping[int, Assignment],
    step_mm: float,
    start_mm: float,
    end_mm: float,
    where: str,
) -> Points:
    """Return the points of a table. Raises ``DataError`` if a point up to the last one was not
    written.

    If a table from another program ends between two points, the value at its end is interpolated.
    """
    position = np.array(grid_mm(start_mm, step_mm, end_mm, len(written), where))
    require_rising(position, where)
    on_grid = abs(position[-1] - position[0] - step_mm * (len(position) - 1)) <= 1e-6
    count = len(position) if on_grid else len(position) - 1
    missing = [str(number) for number in range(count) if number not in written]
    if missing:
        raise DataError(
            where,
            expected=message("points-to", last=count - 1),
            found=message("no-points", numbers=missing[:5]),
            remedy=message("take-again"),
        )
    numbers = sorted(written)
    value_um = np.interp(
        position,
        start_mm + step_mm * np.array(numbers),
        [written[number].number() * 1000 for number in numbers],
    )
    return Points(position_mm=position, value_um=value_um, quantum_um=_quantum_um(written))


def _quantum_um(written: Mapping[int, Assignment]) -> float:
    decimals = max(
        (len(item.value.partition(".")[2]) for item in written.values()), default=4
    )
    return 1000.0 * 10.0 ** -max(decimals, 4)
