"""The change of the readings from survey to proof run: measured, and predicted from the loaded
tables.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings
from stepdiag.base.setups import setup_of
from stepdiag.base.volume import Vector
from stepdiag.exporters.safety.verdicts.regression import Measured, measured
from stepdiag.exporters.tables.tables import Table, correction_um

SAME_MM = 1.0
"""Distance in mm above which two positions belong to different stops of a pass. The commanded and
the actual position of one stop differ by less.
"""
SCALE_UM_M = 5.0
"""Standard uncertainty in um/m of the change of a length between survey and proof run: 0.5 C in the
temperature of the material.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One direction of travel of a setup: stops (N, 3) in the order of travel, and the unit vector
    (3,) along which the reading grows.
    """

    setup: str
    stops_mm: Vector
    along: Vector
    outward: bool

    @property
    def signs(self) -> Vector:
        """Return the sign of each axis' travel, 0 for a standing axis, shape (3,)."""
        signs: Vector = np.sign(np.round(self.along, 6)) * (1 if self.outward else -1)
        return signs

    def seen_um(self, table: Table) -> Vector:
        """Return the effect of a table on the laser's reading at the stops, by the control's law,
        in um.
        """
        moving, output = (
            AXES.index(axis.lower()) for axis in (table.input_axis, table.output_axis)
        )
        ways = (int(self.signs[moving]),) if self.signs[moving] else (1, -1)
        moved = sum(
            (correction_um(table, self.stops_mm[:, moving], way) / len(ways) for way in ways),
            np.zeros(len(self.stops_mm)),
        )
        if table.multiplier is not None:
            moved = moved * table.multiplier.at(
                self.stops_mm[:, AXES.index(table.multiplier.axis.lower())]
            )
        return np.asarray(moved * self.along[output])


def ways_of(readings: Readings, setups: Sequence[str]) -> Iterator[tuple[Way, Vector]]:
    """Yield each direction of travel of some setups, with the mean deviation of its passes at the
    stops in um: reading minus position along the beam.

    If later passes move the axes in another order than the first pass, only the first pass is
    used.
    """
    passes = readings.passes()
    for setup in setups:
        out = next(
            (rows for key, rows in passes.items() if key.setup == setup and key.outward), None
        )
        if out is None:
            continue
        travel = np.array(setup_of(setup).signs) * np.ptp(readings.position_mm[out], axis=0)
        along = travel / np.linalg.norm(travel)
        for outward in (True, False):
            found = [
                rows
                for key, rows in passes.items()
                if key.setup == setup and key.outward == outward
            ]
            alike = [
                rows
                for rows in found
                if _same(readings.position_mm[rows], readings.position_mm[found[0]])
            ]
            if alike:
                deviations = [
                    1000.0 * (readings.reading_mm[rows] - readings.position_mm[rows] @ along)
                    for rows in alike
                ]
                mean = np.mean([each - np.mean(each) for each in deviations], axis=0)
                yield (
                    Way(
                        setup=setup,
                        stops_mm=readings.position_mm[alike[0]],
                        along=along,
                        outward=outward,
                    ),
                    mean,
                )


def changes(before: Readings, after: Readings) -> tuple[list[Way], Vector]:
    """Return the directions of travel that survey and proof run have in common, and the change of
    the readings from survey to proof run in um, concatenated over all their stops.
    """
    ways, parts = [], [np.zeros(0)]
    setups = list(dict.fromkeys(after.setup))
    then = list(ways_of(before, setups))
    for way, now_um in ways_of(after, setups):
        for old, then_um in then:
            if (old.setup, old.outward) == (way.setup, way.outward) and _same(
                old.stops_mm, way.stops_mm
            ):
                ways.append(way)
                parts.append(now_um - then_um)
    return ways, np.concatenate(parts)


def _same(one: Vector, other: Vector) -> bool:
    return one.shape == other.shape and bool(np.max(np.abs(one - other)) < SAME_MM)


def columns(tables: Sequence[Table], ways: Sequence[Way]) -> dict[str, Vector]:
    seen: dict[str, Vector] = {}
    for table in tables:
        own = np.concatenate([way.seen_um(table) for way in ways])
        seen[table.name] = seen[table.name] + own if table.name in seen else own
    return {name: column for name, column in seen.items() if column.any()}


def exchanged(table: Table, one: str, other: str) -> Table:
    """Return a table with the effect that the given table has after two axes are exchanged."""
    names = {one: other, other: one}
    lever = (
        None
        if table.multiplier is None
        else replace(
            table.multiplier, axis=names.get(table.multiplier.axis, table.multiplier.axis)
        )
    )
    moving, output = (names.get(axis, axis) for axis in (table.input_axis, table.output_axis))
    return replace(table, input_axis=moving, output_axis=output, multiplier=lever)


def regressed(ways: Sequence[Way], change_um: Vector, seen: Mapping[str, Vector]) -> Measured:
    """Return the regression of a change of the readings on the effects of each function's tables.

    The regression also estimates an origin for each direction of travel, two tilts of the newly set
    up mirror for each diagonal, and a scale within `SCALE_UM_M`. The scatter has two parts of equal
    size: one of each reading, and one of each arrival of an axis, which stays until the next move
    of this axis.
    """
    count = len(change_um)
    begins = np.cumsum([0, *(len(way.stops_mm) for way in ways)])
    parts = [slice(low, high) for low, high in pairwise(begins)]
    free, held, scatter = [], [], np.eye(count)
    for setup in dict.fromkeys(way.setup for way in ways):
        lean, scale = np.zeros((count, 3)), np.zeros(count)
        for way, part in zip(ways, parts, strict=True):
            if way.setup == setup:
                free.append(np.isin(np.arange(count), np.arange(count)[part]).astype(float))
                metres = 1e-3 * (way.stops_mm - ways[0].stops_mm[0])
                scale[part] = SCALE_UM_M * metres @ way.along
                lean[part] = metres - np.outer(metres @ way.along, way.along)
                for axis in range(3):
                    stays = np.concatenate(
                        [[0], np.cumsum(np.abs(np.diff(way.stops_mm[:, axis])) > SAME_MM)]
                    )
                    scatter[part, part] += way.along[axis] ** 2 * (stays[:, None] == stays)
        held.append(scale)
        leans, size, _ = np.linalg.svd(lean, full_matrices=False)
        free += list(leans[:, size > 1e-9].T)
    return measured(
        change_um,
        np.column_stack(list(seen.values())),
        np.column_stack(free),
        np.column_stack(held),
        scatter,
    )


def unit_u(tables: Sequence[Table], ways: Sequence[Way]) -> dict[str, float]:
    """Return the standard uncertainty of the factor of each function's tables, for the given setups
    and readings that scatter by 1 um. A function whose tables do not change the readings is left
    out.
    """
    seen = columns(tables, ways)
    if not seen:
        return {}
    fit = regressed(ways, np.zeros(sum(len(way.stops_mm) for way in ways)), seen)
    return dict(zip(seen, (fit.u / fit.sigma_um).tolist(), strict=True))
