"""Checks whether a pass follows its setup and whether the laser agrees with the travel."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.readings.readings import PassKey, Readings
from stepdiag.base.setups import Setup
from stepdiag.base.volume import Vector, Volume

SHORTEST_MOVE_MM = 0.05
"""Tolerance in mm for the position along an axis whose run has irregular targets."""
LASER_TOLERANCE = 0.1
"""Largest relative difference between laser travel and nominal travel: a machine error is much
smaller, a wrong unit much larger."""


def check_route(
    readings: Readings,
    setup: Setup,
    key: PassKey,
    rows: NDArray[np.int64],
    volume: Volume,
    source: str,
) -> None:
    """Raise ``DataError`` if the positions of a pass are not the stops of its setup; the message
    contains the stop."""
    where = f"{source}: {key}"
    position = readings.position_mm[rows]
    if len(rows) < 2:
        raise DataError(
            where,
            expected=message("two-stops"),
            found=f"{len(rows)}",
            remedy=message("first-and"),
        )
    signs = np.array(setup.signs) * (1 if key.outward else -1)
    if setup.kind == "linear":
        signs = signs * int(np.sign(np.sum((position[-1] - position[0]) * signs)) or 1)
    _check_each_move(
        setup, position, readings.stop[rows], signs, _least_move_mm(setup, volume), where
    )
    _check_steps(setup, position, readings.stop[rows], volume, where)
    _check_ends(setup, position, signs, volume, where)


def _least_move_mm(setup: Setup, volume: Volume) -> Vector:
    """Return the smallest distance along each axis that counts as a move, shape (3,). A standing
    axis may differ from its target at both stops of a move."""
    own = (
        np.array(setup.signs) != 0 if setup.kind == "linear" else np.zeros(3, dtype=np.bool_)
    )
    return np.where(own, SHORTEST_MOVE_MM, 2.0 * volume.tolerance_mm)


def _check_each_move(
    setup: Setup,
    position: Vector,
    stop: NDArray[np.int64],
    signs: NDArray[np.int64],
    least_mm: Vector,
    where: str,
) -> None:
    moves, steps = np.diff(position, axis=0), np.diff(stop)
    moving = np.abs(moves) > least_mm
    wrong_way = moving & (np.sign(moves) != signs)
    most = np.count_nonzero(signs) if setup.kind in ("step", "face") else 1
    crowded = moving.sum(axis=1) != (np.minimum(steps, most) if setup.kind != "body" else 3)
    for index in np.flatnonzero(wrong_way.any(axis=1) | crowded).tolist():
        found = ", ".join(
            f"{'XYZ'[axis]} by {moves[index, axis]:g} mm"
            for axis in range(3)
            if moving[index, axis]
        ) or message("without-move")
        allowed = " or ".join(
            f"{'XYZ'[axis]}{'+' if signs[axis] > 0 else '-'}"
            for axis in range(3)
            if signs[axis]
        )
        remedy = message("stop-out-of-order")
        raise DataError(
            message("place-stop", run=where, stop=stop[index + 1]),
            expected=message("move-of-all-axes", stop=int(stop[index]))
            if setup.kind == "body"
            else message("move-of-one-axis", allowed=allowed, stop=int(stop[index])),
            found=found,
            remedy=remedy,
        )


def _check_steps(
    setup: Setup, position: Vector, stop: NDArray[np.int64], volume: Volume, where: str
) -> None:
    if setup.kind not in ("step", "face"):
        return
    moved = [axis for axis in range(3) if setup.signs[axis]]
    steps, left = divmod(int(stop[-1]), len(moved))
    if left:
        found = message("number-of-stops", value=int(stop[-1]) + 1)
        raise DataError(
            where,
            expected=message("moves-each", count=len(moved)),
            found=found,
            remedy=message("was-cut"),
        )
    corner = np.flatnonzero(stop % len(moved) == 0)
    ideal = np.array(volume.size_mm) * (stop[corner] // len(moved))[:, None] / steps
    off = np.abs(np.abs(position[corner] - position[0]) - ideal)[:, moved]
    # three times the tolerance, because the positions of two stops and of both edges of the box are
    # uncertain
    if np.any(off > 3.0 * volume.tolerance_mm[moved]):
        worst = int(corner[np.argmax(off.max(axis=1))])
        raise DataError(
            message("place-stop", run=where, stop=stop[worst]),
            expected=message("equal-steps", steps=steps),
            found=message("axes-at", places=[f"{value:g}" for value in position[worst]]),
            remedy=message("pass-too-short"),
        )


def _check_ends(
    setup: Setup, position: Vector, signs: NDArray[np.int64], volume: Volume, where: str
) -> None:
    """Check that a body diagonal runs from corner to corner. A shorter diagonal has another
    direction, or one of its ends is missing."""
    if setup.kind != "body":
        return
    travel = position[-1] - position[0]
    if np.any(np.abs(travel - signs * np.array(volume.size_mm)) > 3.0 * volume.tolerance_mm):
        found = message("all-by", sizes=[f"{value:g}" for value in travel])
        raise DataError(where, expected=message("corner-to-corner"), found=found)


def laser_sense(
    readings: Readings, setup: Setup, passes: Mapping[PassKey, NDArray[np.int64]]
) -> int:
    """Return +1 if the reading of a setup grows along its direction, -1 for a linear run measured
    from its high end.

    With the laser at the high end of the axis, the readings grow towards the low end.
    """
    key, rows = next((key, rows) for key, rows in passes.items() if key.setup == setup.name)
    travel = readings.position_mm[rows[-1]] - readings.position_mm[rows[0]]
    descends = float(travel @ np.array(setup.signs)) * (1 if key.outward else -1) < 0
    return (
        -1
        if setup.kind == "linear" and descends and _laser_ratio(readings, setup, rows) < 0
        else 1
    )


def _laser_ratio(readings: Readings, setup: Setup, rows: NDArray[np.int64]) -> float:
    """Return the median ratio of the laser's steps to their nominal size; single bad stops do not
    change a median."""
    moves = np.diff(readings.position_mm[rows], axis=0)
    extent = np.array(setup.signs) * np.abs(moves).sum(axis=0)
    nominal = moves @ extent / np.linalg.norm(extent)
    return float(np.quantile(np.diff(readings.reading_mm[rows]) / nominal, 0.5))


def check_laser(
    readings: Readings,
    setup: Setup,
    key: PassKey,
    rows: NDArray[np.int64],
    sense: int,
    source: str,
) -> None:
    """Raise ``DataError`` if the laser counted in the wrong direction or in another unit."""
    ratio = sense * _laser_ratio(readings, setup, rows)
    if abs(ratio - 1) <= LASER_TOLERANCE:
        return
    where = f"{source}: {key}"
    if abs(ratio + 1) <= LASER_TOLERANCE:
        raise DataError(
            where,
            expected=message("readings-that-grow"),
            found=message("opposite-sign"),
            remedy=message("set-laser-sign"),
        )
    remedy = message("readings-are-mm-from")
    raise DataError(
        where,
        expected=message("steps-that-agree"),
        found=message("share-of-steps", ratio=ratio),
        remedy=remedy,
    )
