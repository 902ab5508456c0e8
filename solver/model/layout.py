"""The geometry of a survey: the volume, the travel of every pass, the beam, and the deviation of
each reading from its nominal value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, finding, warning
from stepdiag.base.messages import Message, message
from stepdiag.base.readings.readings import PassKey, Readings, missing_stops
from stepdiag.base.readings.snapping import arrivals, edges_mm, snapped_mm
from stepdiag.base.readings.travel import check_laser, check_route, laser_sense
from stepdiag.base.setups import Kind, Setup, setup_of
from stepdiag.base.volume import (
    MOST_INCREMENTS,
    POSITION_TOLERANCE_MM,
    Vector,
    Volume,
    position_tolerance_mm,
)

MOST_SETUPS = 200
BESIDE_NODE = 0.3
"""Largest distance between a node and the nearest target of a run, as a share of an increment:
with a larger distance, the value at the node depends mainly on farther targets."""
MOVES: Mapping[Kind, int] = {"step": 3, "face": 2, "body": 1, "linear": 1}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """The readings of a survey with their geometry, one row for each reading (shape (m,) or (m,
    3)), sorted by pass and stop.

    ``position_mm`` is the target of a stop (`solver.readings.snapping`). ``beside_mm`` is the
    reported position minus the target. ``arrival`` is the number of each axis' last move before the
    stop, -1 for an axis that does not move during the pass. ``direction`` is the unit vector of the
    setup's outward travel. ``beam_mm`` is a point of the beam. ``spot_mm`` is the point of the beam
    nearest to the target (theory 4.3). ``approach`` is the sign of every axis' last move.

    ``deviation_um`` is the reading minus its nominal value at the reported position. Readings with
    the same ``zero_index`` share the zero of the laser's count. Readings of an outward pass and its
    return pass with a common zero have the same ``offset_index``. ``clock`` is the time since the
    start of an out-and-back pair, in hours if ``timed``, else in stops. ``hours`` are time stamps
    and ``temperature_c`` are temperatures of the material, NaN if missing.
    """

    source: str
    volume: Volume
    setups: tuple[Setup, ...]
    passes: tuple[PassKey, ...]
    setup_index: NDArray[np.int64]
    pass_index: NDArray[np.int64]
    zero_index: NDArray[np.int64]
    offset_index: NDArray[np.int64]
    stop: NDArray[np.int64]
    position_mm: Vector
    beside_mm: Vector
    arrival: NDArray[np.int64]
    direction: Vector
    beam_mm: Vector
    spot_mm: Vector
    approach: Vector
    reading_mm: Vector
    deviation_um: Vector
    u_um: Vector
    clock: Vector
    timed: NDArray[np.bool_]
    hours: Vector
    temperature_c: Vector
    findings: tuple[Finding, ...] = ()

    def __len__(self) -> int:
        return len(self.stop)

    def place(self, row: int) -> Message:
        """Return setup, pass and stop of a reading as a message."""
        key = self.passes[int(self.pass_index[row])]
        return message(
            "stop-of-setup", setup=key.setup, number=key.number, stop=int(self.stop[row])
        )

    @property
    def target_index(self) -> NDArray[np.int64]:
        """Return the number of each reading's target, shape (m,); a target has the same number
        in every pass."""
        found: NDArray[np.int64] = np.unique(self.position_mm, axis=0, return_inverse=True)[1]
        return found.ravel()

    @property
    def joined(self) -> bool:
        """Return whether any outward pass and its return pass share the zero of the count, so
        that constant backlash is observable."""
        outward = np.array([key.outward for key in self.passes])[self.pass_index]
        return bool(
            np.intersect1d(self.offset_index[outward], self.offset_index[~outward]).size
        )

    def since_zero_mm(self) -> Vector:
        first = np.unique(self.zero_index, return_index=True)[1]
        counted: Vector = (
            self.reading_mm
            - self.reading_mm[first][np.searchsorted(self.zero_index[first], self.zero_index)]
        )
        return counted

    def select(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> "Layout":
        """Return the layout of the readings ``rows``. Setups and passes keep their numbers."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _COLUMNS})

    def leaning(self, tilt_mrad: Vector) -> "Layout":
        """Return the layout at the reported positions, with the mirror and the beam of each setup
        tilted by ``tilt_mrad`` (setups, 3).

        A laser measures machine errors along the normal of the mirror. Autocollimation makes the
        beam parallel to this normal. ``deviation_um`` does not change, because the tilt unknowns
        explain the effect of the tilt on the nominal travel.
        """
        leaning = self.direction + 1e-3 * tilt_mrad[self.setup_index]
        leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
        position = self.position_mm + self.beside_mm
        return replace(
            self,
            position_mm=position,
            direction=leaning,
            spot_mm=_foot(self.beam_mm, leaning, position),
        )


_COLUMNS = (
    "setup_index",
    "pass_index",
    "zero_index",
    "offset_index",
    "stop",
    "position_mm",
    "beside_mm",
    "arrival",
    "direction",
    "beam_mm",
    "spot_mm",
    "approach",
    "reading_mm",
    "deviation_um",
    "u_um",
    "clock",
    "timed",
    "hours",
    "temperature_c",
)


def lay_out(
    readings: Readings, source: str = "readings", volume: Volume | None = None
) -> Layout:
    """Return the geometry of readings.

    Without ``volume``, size and increments are computed from the first available kind of setup:
    step diagonals, face diagonals, continuous diagonals, linear runs. An axis that no setup travels
    has no length. Stops outside the volume are omitted with a finding. Raises ``DataError``, with
    the name of the stop, if the positions do not form a box, a pass does not fit its setup, or the
    laser contradicts the travel.
    """
    passes = readings.passes()
    if not passes:
        raise DataError(source, expected=message("some-readings"), found=message("none"))
    setups = {name: setup_of(name) for name in dict.fromkeys(key.setup for key in passes)}
    if len(setups) > MOST_SETUPS:
        raise DataError(
            source, expected=message("setups-most", count=MOST_SETUPS), found=str(len(setups))
        )
    volume = volume or infer_volume(readings, setups.values(), source)
    for key, rows in passes.items():
        check_route(readings, setups[key.setup], key, rows, volume, source)
        check_laser(
            readings,
            setups[key.setup],
            key,
            rows,
            laser_sense(readings, setups[key.setup], passes),
            source,
        )
    return _inside_only(
        _assemble(readings, passes, list(setups.values()), volume, source),
        _missing(readings, passes),
    )


def infer_volume(
    readings: Readings, setups: Iterable[Setup], source: str = "readings"
) -> Volume:
    """Return the common box of the setups. Raises ``DataError`` if there is no common box."""
    by_kind: dict[Kind, list[Setup]] = {}
    for setup in setups:
        by_kind.setdefault(setup.kind, []).append(setup)
    kinds: tuple[Kind, ...] = ("step", "face", "body", "linear")
    kind = next(kind for kind in kinds if kind in by_kind)
    ordered = [by_kind[one] for one in kinds if one in by_kind]
    low, high = (
        np.array(edge)
        for edge in zip(
            *(_edges_mm(readings, ordered, axis) for axis in range(3)), strict=True
        )
    )
    finest = _increments(readings, [setup.name for setup in by_kind[kind]], kind, source)
    if kind == "linear":
        finest = _even_steps(readings, by_kind[kind], low, high, finest)
    names = np.array(readings.setup)
    for setup in by_kind[kind]:
        _check_box(
            setup, readings.position_mm[names == setup.name], low, high, finest, source
        )
    x, y, z = (float(value) for value in low)
    a, b, c = (float(value) for value in np.round(high - low, 6))
    return Volume(origin_mm=(x, y, z), size_mm=(a, b, c), increments=finest)


def _edges_mm(
    readings: Readings, kinds: Sequence[Sequence[Setup]], axis: int
) -> tuple[float, float]:
    """Return the low and the high edge of the box along an axis, from the first of the ``kinds``
    of setups that travels this axis. If no setup travels the axis, the edges are the lowest and
    highest position of the axis."""
    travelling = ([setup for setup in setups if setup.signs[axis]] for setups in kinds)
    signs = {setup.name: setup for setup in next(filter(None, travelling), [])}
    position, steps = [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for key, rows in readings.passes().items():
        if key.setup not in signs:
            continue
        setup = signs[key.setup]
        # the targets of a linear run can be anywhere between its two ends
        used = rows[[0, -1]] if setup.kind == "linear" else rows
        position.append(readings.position_mm[used, axis])
        steps.append(
            np.full(
                len(used),
                1
                if setup.kind == "linear"
                else max(int(readings.stop[rows[-1]]) // MOVES[setup.kind], 1),
            )
        )
    if len(position) == 1:
        return edges_mm(readings.position_mm[:, axis], np.ones(len(readings), dtype=np.int64))
    return edges_mm(np.concatenate(position), np.concatenate(steps))


def _even_steps(
    readings: Readings, runs: Sequence[Setup], low: Vector, high: Vector, most: int
) -> int:
    """Return the largest number of equal increments for which every node has a near target
    (`BESIDE_NODE`) in each run."""
    shares = []
    for setup in runs:
        axis = int(np.argmax(np.abs(setup.signs)))
        position = readings.position_mm[np.array(readings.setup) == setup.name, axis]
        shares.append(np.sort((position - low[axis]) / (high[axis] - low[axis])))
    return next(
        (
            steps
            for steps in range(most, 1, -1)
            if all(_beside_nodes(share, steps) for share in shares)
        ),
        1,
    )


def _beside_nodes(share: Vector, steps: int) -> bool:
    nodes = np.arange(1, steps) / steps
    above = np.clip(np.searchsorted(share, nodes), 1, len(share) - 1)
    nearest = np.minimum(np.abs(nodes - share[above - 1]), np.abs(share[above] - nodes))
    return bool(np.all(nearest * steps <= BESIDE_NODE))


def _check_box(
    setup: Setup, points: Vector, low: Vector, high: Vector, increments: int, source: str
) -> None:
    moves = np.array(setup.signs) != 0
    off = (
        np.maximum(np.abs(points.min(axis=0) - low), np.abs(points.max(axis=0) - high))
        * moves
    )
    # the stop and the edge of the box each have a tolerance
    if np.any(off > 2.0 * position_tolerance_mm((high - low) / increments)):
        axis = int(np.argmax(off))
        raise DataError(
            f"{source}: setup {setup.name}",
            expected=message(
                "as-others", axis="XYZ"[axis], low=low[axis], high_mm=high[axis]
            ),
            found=message("mm-to", low=points[:, axis].min(), high_mm=points[:, axis].max()),
            remedy=message("all-diagonals-survey-span"),
        )


def _increments(readings: Readings, names: Sequence[str], kind: Kind, source: str) -> int:
    longest = max(
        int(readings.stop[rows[-1]])
        for key, rows in readings.passes().items()
        if key.setup in names
    )
    increments = max(longest // MOVES[kind], 1)
    if increments > MOST_INCREMENTS:
        raise DataError(
            source,
            expected=message("increments-most", count=MOST_INCREMENTS),
            found=str(increments),
        )
    return increments


def _assemble(
    readings: Readings,
    passes: dict[PassKey, NDArray[np.int64]],
    setups: list[Setup],
    volume: Volume,
    source: str,
) -> Layout:
    keys = tuple(passes)
    order = np.concatenate(list(passes.values()))
    pass_index = np.repeat(np.arange(len(keys)), [len(rows) for rows in passes.values()])
    place = {setup.name: index for index, setup in enumerate(setups)}
    setup_index = np.array([place[key.setup] for key in keys])[pass_index]
    reported = readings.position_mm[order]
    position = snapped_mm(
        volume, reported, targets_tolerance_mm(readings, passes, setups, volume)
    )
    first = np.searchsorted(pass_index, np.arange(len(keys)))
    zero_index, offset_index, origin = _zeros(readings.zero[order], keys, pass_index)
    beam = np.where(
        np.isfinite(readings.beam_mm[order]),
        readings.beam_mm[order],
        position[first][pass_index],
    )
    senses = np.array([laser_sense(readings, setup, passes) for setup in setups])
    direction = (senses[:, None] * np.array([_direction(setup, volume) for setup in setups]))[
        setup_index
    ]
    reading = readings.reading_mm[order]
    nominal = np.sum((reported - reported[origin]) * direction, axis=1)
    clock, timed = _drift_clock(readings.time_s[order], keys, pass_index)
    last = np.append(first[1:], len(position)) - 1
    travel = position[last] - position[first]
    return Layout(
        source=source,
        volume=volume,
        setups=tuple(setups),
        passes=keys,
        setup_index=setup_index,
        pass_index=pass_index,
        zero_index=zero_index,
        offset_index=offset_index,
        stop=readings.stop[order],
        position_mm=position,
        beside_mm=reported - position,
        arrival=arrivals(position, pass_index, readings.turned[order]),
        direction=direction,
        beam_mm=beam,
        spot_mm=_foot(beam, direction, position),
        approach=_approach(
            np.sign(travel)[pass_index], pass_index, position, readings.turned[order]
        ),
        reading_mm=reading,
        deviation_um=(reading - reading[origin] - nominal) * 1e3,
        u_um=readings.u_um[order],
        clock=clock,
        timed=timed,
        hours=readings.time_s[order] / 3600.0,
        temperature_c=readings.temperature_c[order],
    )


def targets_tolerance_mm(
    readings: Readings,
    passes: Mapping[PassKey, NDArray[np.int64]],
    setups: Sequence[Setup],
    volume: Volume,
) -> Vector:
    """Return the largest allowed distance between a stop and its target in each axis, shape
    (3,), with a smaller value for an axis with a fine linear run."""
    step, runs = (
        volume.step_mm.copy(),
        {setup.name: setup for setup in setups if setup.kind == "linear"},
    )
    for key, rows in passes.items():
        if key.setup in runs:
            axis = int(np.argmax(np.abs(runs[key.setup].signs)))
            step[axis] = min(
                step[axis], float(np.min(np.abs(np.diff(readings.position_mm[rows, axis]))))
            )
    return position_tolerance_mm(step)


def _zeros(
    zero: NDArray[np.int64], keys: Sequence[PassKey], pass_index: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    stretches: dict[tuple[str, int, int], int] = {}
    offsets: dict[tuple[int, int], int] = {}
    begins = np.flatnonzero(
        np.append(True, (np.diff(pass_index) != 0) | (np.diff(zero) != 0))
    )
    runs = [
        (number, keys[index])
        for number, index in zip(
            zero[begins].tolist(), pass_index[begins].tolist(), strict=True
        )
    ]
    # the count of a pass without a ``zero`` number is unbroken within this pass only
    stretch = [
        stretches.setdefault(
            (key.setup, number, 0 if number >= 0 else key.number), len(stretches)
        )
        for number, key in runs
    ]
    pairs = [(of, (key.number + 1) // 2) for of, (_, key) in zip(stretch, runs, strict=True)]
    offset = [offsets.setdefault(pair, len(offsets)) for pair in pairs]
    length = np.diff(np.append(begins, len(zero)))
    zero_index, offset_index = (
        np.repeat(np.array(stretch, dtype=np.int64), length),
        np.repeat(np.array(offset, dtype=np.int64), length),
    )
    first = np.unique(zero_index, return_index=True)[1]
    return zero_index, offset_index, first[zero_index]


def _approach(
    travelled: Vector,
    pass_index: NDArray[np.int64],
    position_mm: Vector,
    turned: NDArray[np.bool_],
) -> Vector:
    """Return the sign of every axis' last move before each stop, shape (m, 3): the sign of its
    travel in the pass.

    If the machine reversed at the first stop, each axis has the sign of the previous pass until its
    next move.
    """
    approach = travelled.copy()
    for first in np.flatnonzero(turned).tolist():
        approach[first] = -travelled[first]
        for row in range(
            first + 1, int(np.searchsorted(pass_index, pass_index[first], side="right"))
        ):
            moved = position_mm[row] - position_mm[row - 1]
            approach[row] = np.where(moved != 0, np.sign(moved), approach[row - 1])
    return approach


def _foot(beam_mm: Vector, direction: Vector, position_mm: Vector) -> Vector:
    along: Vector = np.sum((position_mm - beam_mm) * direction, axis=1, keepdims=True)
    return beam_mm + direction * along


def _direction(setup: Setup, volume: Volume) -> Vector:
    travel = np.array(setup.signs) * np.array(volume.size_mm)
    unit: Vector = travel / np.linalg.norm(travel)
    return unit


def _drift_clock(
    time_s: Vector, keys: Sequence[PassKey], pass_index: NDArray[np.int64]
) -> tuple[Vector, NDArray[np.bool_]]:
    clock = np.zeros(len(time_s))
    timed = np.zeros(len(time_s), dtype=np.bool_)
    pair_of = [(key.setup, (key.number + 1) // 2) for key in keys]
    for pair in dict.fromkeys(pair_of):
        rows = np.isin(
            pass_index, [index for index, other in enumerate(pair_of) if other == pair]
        )
        stamps = time_s[rows]
        known = bool(np.all(np.isfinite(stamps)))
        clock[rows] = (stamps - stamps.min()) / 3600.0 if known else np.arange(len(stamps))
        timed[rows] = known
    return clock, timed


def _missing(
    readings: Readings, passes: dict[PassKey, NDArray[np.int64]]
) -> tuple[Finding, ...]:
    lacking = {key: missing_stops(readings.stop[rows]) for key, rows in passes.items()}
    named = [
        message("stops-of-setup", setup=key.setup, number=key.number, stops=stops.tolist())
        for key, stops in lacking.items()
        if len(stops)
    ]
    return (warning("stop-missing", lacking=named),) if named else ()


def _inside_only(layout: Layout, findings: tuple[Finding, ...]) -> Layout:
    low = np.array(layout.volume.origin_mm)
    beyond = np.maximum(
        low - layout.position_mm, layout.position_mm - low - layout.volume.size_mm
    )
    outside = np.any(beyond > POSITION_TOLERANCE_MM, axis=1)
    if not outside.any():
        return replace(layout, findings=findings)
    first = layout.place(int(np.argmax(outside)))
    words = message("outside-volume", count=int(outside.sum()), place=first)
    return replace(layout.select(~outside), findings=(finding("info", words), *findings))
