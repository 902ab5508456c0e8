"""The readings of a sign test: two linear runs with a laser, or a small CSV from a dial or a
straightness laser.
"""

from typing import NamedTuple

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import number_rows

HEADER = "position_mm,off_um,on_um"
_SAME_MM = 1e-3
_GROWTH = 0.01
"""Largest difference from 1 of the slope of the reading over the position: no machine has an error
of 10 mm per metre.
"""


class SignRun(NamedTuple):
    """Commanded positions of the input axis, and actual positions of the output axis with the table
    off and on; ascending.

    If ``grows`` is true, the readings of both runs grow with the position, so the counting
    direction of the laser is known.
    """

    position_mm: Vector
    off_um: Vector
    on_um: Vector
    grows: bool = False


def from_readings(off: Readings, on: Readings, axis: str) -> SignRun:
    """Return the run along ``axis`` (X, Y, Z) from its linear run with the table off and the same
    run with the table on.

    The readings of all passes of ``linear-x`` .. are averaged by position. Raises ``DataError`` if
    a run is missing, the positions differ, or the readings do not grow with the position.
    """
    before, after = (
        _by_position(readings, axis, state) for readings, state in ((off, "off"), (on, "on"))
    )
    if len(before) != len(after) or any(
        abs(one - other) > _SAME_MM for one, other in zip(before, after, strict=True)
    ):
        raise DataError(
            message("sign-test-along", axis=axis),
            expected=message("same-commanded-positions-with"),
            found=message("and-positions", off=len(before), on=len(after)),
        )
    position = np.array(list(before))
    shift = 1000.0 * position
    actual = {
        state: np.array(list(run.values())) for state, run in (("off", before), ("on", after))
    }
    for state, um in actual.items():
        growth = float(np.polyfit(position, um / 1000.0, 1)[0]) if len(position) > 1 else 1.0
        if abs(growth - 1.0) > _GROWTH:
            raise DataError(
                message("sign-test-table", state=state),
                expected=message("readings-grow"),
                found=message("laser-backwards", growth=growth)
                if growth < 0.0
                else message("readings-growth", growth=growth),
            )
    return SignRun(position, actual["off"] - shift, actual["on"] - shift, grows=True)


def _by_position(readings: Readings, axis: str, state: str) -> dict[float, float]:
    along = readings.position_mm[:, AXES.index(axis.lower())]
    actual: dict[float, list[float]] = {}
    for key, rows in readings.passes().items():
        if key.setup == f"linear-{axis.lower()}":
            for row in rows:
                actual.setdefault(round(float(along[row]), 4), []).append(
                    1000.0 * float(along[rows[0]] + readings.reading_mm[row])
                )
    if not actual:
        raise DataError(
            message("sign-test-table", state=state),
            expected=message("run-linear", axis=axis.lower()),
            found=", ".join(sorted(set(readings.setup))) or message("nothing"),
        )
    return {at: float(np.mean(actual[at])) for at in sorted(actual)}


def read_sign_run(file: ControlFile) -> SignRun:
    """Return the run in a CSV ``position_mm,off_um,on_um``. Raises ``DataError``, with the line,
    for a damaged file.
    """
    rows = number_rows(file, HEADER, message("three-numbers"))
    position, off, on = rows[np.argsort(rows[:, 0])].T
    return SignRun(position, off, on)
