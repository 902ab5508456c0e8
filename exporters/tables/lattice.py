"""The correction as a lattice of vectors: the neutral form for volumetric compensation (FANUC 3-D
and others), as CSV.

Every vertex contains the displacement to ADD to the command: the negative error field of the
result, with its Abbe arms. Only a lattice contains the full effect of the angular errors. Between
the vertices a control interpolates linearly in three directions (A-79351E p. 3).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.base.errors import DataError, SafetyError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import MOST_LINES, ascii_lines, number_rows
from stepdiag.exporters.files.numbers import fixed, shortest
from stepdiag.exporters.tables.profile import whole_steps

NAME = "lattice"
HEADER = "x_mm,y_mm,z_mm,cx_um,cy_um,cz_um"
_DECIMALS = 3
"""Decimal places of a vector in um: the last place is 1 nm, below the resolution of every
control.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """The vertices of a lattice, at all combinations of three lists of ascending positions;
    ``vectors_um`` has the shape (nx, ny, nz, 3).
    """

    axes_mm: tuple[Vector, Vector, Vector]
    vectors_um: Vector

    def correction_um(self, points_mm: Vector) -> Vector:
        """Return the trilinear correction at points, shape (N, 3); outside the lattice the values
        of the nearest face are used.
        """
        total = np.zeros(points_mm.shape)
        cells = [_cell(axis, points_mm[:, index]) for index, axis in enumerate(self.axes_mm)]
        for corner in np.ndindex(2, 2, 2):
            at = tuple(low + side for (low, _), side in zip(cells, corner, strict=True))
            weight = np.prod(
                [
                    share if side else 1 - share
                    for (_, share), side in zip(cells, corner, strict=True)
                ],
                axis=0,
            )
            total += weight[:, None] * self.vectors_um[at]
        return total


def _cell(
    axis: Vector, at: Vector
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int64]], Vector]:
    """Return, along one axis, the index of the lower vertex of each position's cell, and the
    position within the cell (0 to 1).
    """
    inside = np.clip(at, axis[0], axis[-1])
    low = np.clip(np.searchsorted(axis, inside, side="right") - 1, 0, len(axis) - 2).astype(
        np.int64
    )
    return low, (inside - axis[low]) / (axis[low + 1] - axis[low])


def lattice_of(result: Result, step_mm: float | Sequence[float]) -> Lattice:
    """Return the lattice over the measured volume, with one step for all axes or one for each axis.

    Raises ``SafetyError`` for a step that does not divide the travel, ``DataError`` for a survey of
    axes without a volume.
    """
    if not result.volume.solid:
        raise DataError(
            f"{result.source}: volume",
            expected=message("of-volume"),
            found=message("axes-alone"),
        )
    steps_mm = np.broadcast_to(step_mm, 3).tolist()
    count = math.prod(
        size / each + 1.0 for size, each in zip(result.volume.size_mm, steps_mm, strict=True)
    )
    if not count <= MOST_LINES:
        found = ", ".join(f"{each:g}" for each in dict.fromkeys(steps_mm))
        raise UsageError(
            "--step-mm",
            expected=message("vertices-step", count=MOST_LINES),
            found=f"{found} mm",
        )
    x, y, z = (_axis(result.volume, index, each) for index, each in enumerate(steps_mm))
    return lattice_on(result, (x, y, z))


def lattice_on(
    result: Result, axes_mm: tuple[Vector, Vector, Vector], active: Lattice | None = None
) -> Lattice:
    """Return the lattice at the given positions of the axes, rounded to 1 nm. A vertex outside the
    measured volume has the error of the nearest point in the volume.

    ``active`` is the lattice that was active during the measurement; the new lattice replaces
    it.
    """
    points = np.stack(np.meshgrid(*axes_mm, indexing="ij"), axis=-1).reshape(-1, 3)
    low = np.asarray(result.volume.origin_mm)
    vectors = -error_field_um(
        result, np.clip(points, low, low + np.asarray(result.volume.size_mm))
    )
    if active is not None:
        vectors = vectors + active.correction_um(points)
    shape = tuple(len(axis) for axis in axes_mm)
    return Lattice(
        axes_mm=axes_mm, vectors_um=np.round(vectors, _DECIMALS).reshape(*shape, 3)
    )


def render(lattice: Lattice) -> ControlFile:
    """Return the file ``lattice.csv`` with one row for each vertex; z changes fastest. Vectors are
    rounded to 1 nm.
    """
    rows = [HEADER]
    for index in np.ndindex(lattice.vectors_um.shape[:3]):
        place = [
            shortest(float(axis[n])) for axis, n in zip(lattice.axes_mm, index, strict=True)
        ]
        rows.append(
            ",".join(
                [
                    *place,
                    *(fixed(float(value), _DECIMALS) for value in lattice.vectors_um[index]),
                ]
            )
        )
    return ControlFile(name="lattice.csv", data=ascii_lines(rows))


def recognises(file: ControlFile) -> bool:
    return file.data.startswith(HEADER.encode("ascii"))


def the_one_in(files: Sequence[ControlFile], where: str) -> ControlFile:
    """Return the file of the lattice that was active. Raises ``SafetyError`` if ``files`` contain
    another compensation.
    """
    given = [file for file in files if recognises(file)]
    if len(files) != 1 or not given:
        raise SafetyError(
            f"{where}: machine.existing",
            code="active-table-unfit.tables",
            expected=message("one-lattice"),
            found=", ".join(file.name for file in files) or message("nothing"),
            remedy=message("no-merge"),
        )
    return given[0]


def parse(file: ControlFile) -> Lattice:
    """Return the lattice in a file. Raises ``DataError``, with the line, for a damaged file, and
    for a lattice with missing vertices.
    """
    rows = number_rows(file, HEADER, message("six-numbers"))
    axes = tuple(np.unique(rows[:, index]) for index in range(3))
    shape = tuple(len(axis) for axis in axes)
    whole = min(shape) >= 2 and math.prod(shape) == len(rows)
    if not whole or not np.array_equal(
        rows[:, :3], np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    ):
        raise DataError(
            file.name,
            expected=message("whole-lattice"),
            found=message("count-rows", count=len(rows)),
            remedy=message("mixed-up"),
        )
    return Lattice(
        axes_mm=(axes[0], axes[1], axes[2]), vectors_um=rows[:, 3:].reshape(*shape, 3)
    )


def _axis(volume: Volume, index: int, step_mm: float) -> Vector:
    low, size = volume.origin_mm[index], volume.size_mm[index]
    count = whole_steps(size, step_mm)
    if count is None:
        raise SafetyError(
            "--step-mm",
            code="grid-unfit.step",
            expected=message("divides-of", size_mm=size, axis="XYZ"[index]),
            found=f"{step_mm:g} mm",
        )
    steps: Vector = low + step_mm * np.arange(count + 1, dtype=np.float64)
    return steps
