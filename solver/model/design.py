"""The linear model: each reading is a sum of the machine's errors at the nodes and the unknowns of
its setup.

    deviation =
      d . sum_a delta_a(a) + sum_a alpha_a(a) . ((spot - O_a) x d)   theory 4.3, first order
      + approach_a / 2 * d . (play_a + reversal_a(a))                for out-and-back data
      + nu . (P - P_0) + offset + drift * time                       mirror tilt: theory 4.2
      + d . sum_a miss_a(last move of axis a)                        solver.adjustment.scatter

``play_a`` is the reversal at the low end of axis a. The reversal ``play_a`` is an unknown if an
outward pass and its return pass share the zero of the laser's count; otherwise the offsets of the
passes include ``play_a``.

Units: um, urad, mm; tilts in mrad. The errors of the machine are zero at the first node of each
axis and linear between nodes. A rigid rotation of the machine is not determined by the readings;
`solver.linear.least_squares` computes all such directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.kinematics import abbe_mask, cross_matrix
from stepdiag.base.readings.readings import PassKey
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.linear.elimination import Blocks, order_blocks
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.layout import Layout

_ROUNDING = 1e-9
"""Difference of two positions, as a share of an increment, below which it is rounding."""
FEW_UNKNOWNS = 128
"""Smallest number of unknowns that the elimination splits into blocks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """The optional unknowns of the design; displacements, offsets, tilts and drifts are always
    unknowns.

    ``lines`` is the number of passes of the 4-DOF head, counted for each lateral direction.
    ``misses`` adds the positioning deviation of each move as an unknown; only a prior separates it
    from the machine's errors (`solver.model.priors`).
    """

    angles: bool = False
    reversal: bool = False
    play: bool = False
    lines: int = 0
    misses: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """The column numbers of the unknowns. A function has a part (0 displacement, 1 rotation, 2
    reversal), an axis and a component.

    ``play`` is the first column of the nine reversals at the low ends of the axes; ``play ==
    offset`` means that there are none. ``line`` is the first column of the offsets and slopes of
    `solver.model.lateral`. ``miss`` is the first column of the positioning deviations of the moves.
    """

    nodes: int
    parts: tuple[int, ...]
    play: int
    offset: int
    tilt: int
    tilt_setup: tuple[int, ...]
    drift: int
    line: int
    miss: int
    count: int

    @property
    def machine(self) -> int:
        """Return the number of the machine's unknowns, which are the first columns."""
        return self.offset

    def of(self, part: int, axis: int, component: int) -> NDArray[np.int64]:
        start = self.parts.index(part) * 9 * self.nodes
        nodes: NDArray[np.int64] = (
            start + (axis * self.nodes + np.arange(self.nodes)) * 3 + component
        )
        return nodes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """The rows of all readings, and the properties of the tilt and drift columns.

    ``tilt_direction`` (k, 3) is the direction of each mirror tilt. ``drift_pairs`` contains for
    each drift column the setup, the number of the out-and-back pair, and True for a drift per hour
    or False for a drift per stop. ``drift_spans`` is the duration of each pair in hours or stops.
    """

    volume: Volume
    chain: str
    columns: Columns
    rows: Rows
    blocks: Blocks
    tilt_direction: Vector
    drift_pairs: tuple[tuple[str, int, bool], ...]
    drift_spans: tuple[float, ...]


def build_design(layout: Layout, chain: str, model: Model) -> Design:
    """Return the design of a survey. Raises ``UsageError`` for an invalid kinematic chain."""
    tilt_setup, tilt_direction = _tilts(layout)
    pairs = _drift_pairs(layout)
    parts = tuple(
        part for part, wanted in enumerate((True, model.angles, model.reversal)) if wanted
    )
    nodes = layout.volume.increments
    play = 9 * nodes * len(parts)
    offset = play + (9 if model.reversal and model.play else 0)
    tilt = offset + int(layout.offset_index.max(initial=-1)) + 1
    drift = tilt + len(tilt_setup)
    line = drift + len(pairs)
    miss = line + 2 * model.lines
    columns = Columns(
        nodes=nodes,
        parts=parts,
        play=play,
        offset=offset,
        tilt=tilt,
        tilt_setup=tilt_setup,
        drift=drift,
        line=line,
        miss=miss,
        count=miss + (int(layout.arrival.max(initial=-1)) + 1 if model.misses else 0),
    )
    pieces = [
        _machine_entries(layout, chain, columns),
        _play_entries(layout, columns),
        _offset_entries(layout, columns),
    ]
    pieces += [
        _tilt_entries(layout, columns, tilt_direction),
        _drift_entries(layout, columns, pairs),
        _miss_entries(layout, columns),
    ]
    rows = _packed_rows(pieces, columns)
    return Design(
        volume=layout.volume,
        chain=chain,
        columns=columns,
        rows=rows,
        blocks=order_blocks(_groups(layout, columns, rows)),
        tilt_direction=tilt_direction,
        drift_pairs=tuple(
            (setup, pair, bool(np.all(layout.timed[rows]))) for setup, pair, rows in pairs
        ),
        drift_spans=tuple(float(np.max(layout.clock[rows])) for _, _, rows in pairs),
    )


def machine_rows(layout: Layout, chain: str, columns: Columns) -> Rows:
    """Return the effect of the machine's unknowns on every reading, as in `build_design`."""
    return _packed_rows(
        [_machine_entries(layout, chain, columns), _play_entries(layout, columns)], columns
    )


def _packed_rows(
    pieces: Sequence[tuple[NDArray[np.int64], Vector]], columns: Columns
) -> Rows:
    return Rows(
        np.hstack([column for column, _ in pieces]),
        np.hstack([value for _, value in pieces]),
        columns.count,
    )


def between_nodes(volume: Volume, position_mm: Vector) -> tuple[NDArray[np.int64], Vector]:
    """Return, for positions (m, 3), the node below and the fraction of the increment from this
    node. Rounding errors of a position at a node are removed."""
    steps = (position_mm - volume.origin_mm) / volume.length_mm * volume.increments
    near = np.round(steps)
    steps = np.where(np.abs(steps - near) <= _ROUNDING, near, steps)
    lower = np.clip(np.floor(steps), 0, volume.increments - 1)
    return lower.astype(np.int64), steps - lower


def displacement_coefficients(layout: Layout) -> Vector:
    """Return the change of each reading in um for 1 um of displacement, shape (m, axis,
    component): the beam direction d."""
    return np.repeat(layout.direction[:, None, :], 3, axis=1)


def rotation_coefficients(layout: Layout, chain: str) -> Vector:
    """Return the change of each reading in um for 1 urad of rotation, shape (m, axis, component):
    (spot - O_a) x d in m (theory 4.3).

    Abbe arms begin at the low corner of the volume, because the displacement functions are defined
    on the lines through this corner.
    """
    from_corner = layout.position_mm - layout.volume.origin_mm
    carriage = (1.0 - abbe_mask(chain)) * from_corner[:, None, :]
    arm = (layout.spot_mm - layout.volume.origin_mm)[:, None, :] - carriage
    lever: Vector = np.einsum("macb,mb->mac", cross_matrix(arm), layout.direction)
    return lever * 1e-3


def _machine_entries(
    layout: Layout, chain: str, columns: Columns
) -> tuple[NDArray[np.int64], Vector]:
    coefficients = {0: displacement_coefficients(layout)}
    if 1 in columns.parts:
        coefficients[1] = rotation_coefficients(layout, chain)
    if 2 in columns.parts:
        coefficients[2] = coefficients[0] * layout.approach[:, :, None] / 2.0
    lower, fraction = between_nodes(layout.volume, layout.position_mm)
    on_nodes = bool(np.all((fraction == 0) | (fraction == 1)))
    neighbours = (
        [(np.where(fraction == 1, lower + 1, lower), np.ones_like(fraction))]
        if on_nodes
        else []
    )
    neighbours = neighbours or [(lower, 1.0 - fraction), (lower + 1, fraction)]
    pieces = [
        _function_entries(columns, part, node, weight[:, :, None] * coefficient)
        for part, coefficient in coefficients.items()
        for node, weight in neighbours
    ]
    return np.hstack([column for column, _ in pieces]), np.hstack(
        [value for _, value in pieces]
    )


def _function_entries(
    columns: Columns, part: int, node: NDArray[np.int64], value: Vector
) -> tuple[NDArray[np.int64], Vector]:
    start = columns.parts.index(part) * 9 * columns.nodes
    known = np.maximum(node, 1) - 1
    column = start + ((np.arange(3) * columns.nodes + known) * 3)[:, :, None] + np.arange(3)
    return column.reshape(len(node), 9), (value * (node > 0)[:, :, None]).reshape(
        len(node), 9
    )


def _play_entries(layout: Layout, columns: Columns) -> tuple[NDArray[np.int64], Vector]:
    count = columns.offset - columns.play
    column = np.broadcast_to(columns.play + np.arange(count), (len(layout), count))
    value = displacement_coefficients(layout) * layout.approach[:, :, None] / 2.0
    return column, value.reshape(len(layout), 9)[:, :count]


def _offset_entries(layout: Layout, columns: Columns) -> tuple[NDArray[np.int64], Vector]:
    """Return columns and values of the offsets of the count: the first stop has noise like all
    other stops, so its value is an unknown.

    An outward pass and its return pass share an offset. Each repetition has its own offset, so a
    drift of the count between repetitions has no effect.
    """
    return (columns.offset + layout.offset_index)[:, None], np.ones((len(layout), 1))


def _tilts(layout: Layout) -> tuple[tuple[int, ...], Vector]:
    """Return the setup and the direction of every observable mirror tilt. A tilt in a direction
    across the beam is observable if the target travels in this direction."""
    setups: list[int] = []
    directions: list[Vector] = [np.zeros((0, 3))]
    for index in range(len(layout.setups)):
        mine = layout.setup_index == index
        position, direction = layout.position_mm[mine], layout.direction[mine]
        away = position - position[:1]
        across = away - direction * np.sum(away * direction, axis=1, keepdims=True)
        _, size, axes = np.linalg.svd(across, full_matrices=False)
        shown = (
            axes[size > 1e-3 * np.linalg.norm(layout.volume.size_mm)]
            if mine.any()
            else axes[:0]
        )
        setups += [index] * len(shown)
        directions.append(
            shown
            * np.sign(shown[np.arange(len(shown)), np.argmax(np.abs(shown), axis=1)])[:, None]
        )
    return tuple(setups), np.vstack(directions)


def _tilt_entries(
    layout: Layout, columns: Columns, tilt_direction: Vector
) -> tuple[NDArray[np.int64], Vector]:
    column = np.zeros((len(layout), 2), dtype=np.int64)
    value = np.zeros((len(layout), 2))
    from_corner = layout.position_mm - layout.volume.origin_mm
    for tilt, (setup, direction) in enumerate(
        zip(columns.tilt_setup, tilt_direction, strict=True)
    ):
        place = tilt - columns.tilt_setup.index(setup)
        mine = layout.setup_index == setup
        column[mine, place] = columns.tilt + tilt
        value[mine, place] = from_corner[mine] @ direction
    return column, value


def _drift_pairs(layout: Layout) -> list[tuple[str, int, NDArray[np.bool_]]]:
    numbers = {key: index for index, key in enumerate(layout.passes)}
    pairs = []
    for key, index in numbers.items():
        back = numbers.get(PassKey(key.setup, key.number + 1))
        if key.outward and back is not None:
            pairs.append(
                (key.setup, (key.number + 1) // 2, np.isin(layout.pass_index, [index, back]))
            )
    return pairs


def _drift_entries(
    layout: Layout, columns: Columns, pairs: list[tuple[str, int, NDArray[np.bool_]]]
) -> tuple[NDArray[np.int64], Vector]:
    column, value = np.zeros(len(layout), dtype=np.int64), np.zeros(len(layout))
    for index, (_, _, mine) in enumerate(pairs):
        column[mine] = columns.drift + index
        value[mine] = layout.clock[mine]
    return column[:, None], value[:, None]


def _miss_entries(layout: Layout, columns: Columns) -> tuple[NDArray[np.int64], Vector]:
    if columns.count == columns.miss:
        return np.zeros((len(layout), 0), dtype=np.int64), np.zeros((len(layout), 0))
    travels = layout.arrival >= 0
    return columns.miss + np.where(travels, layout.arrival, 0), layout.direction * travels


def _groups(layout: Layout, columns: Columns, rows: Rows) -> NDArray[np.int64]:
    """Return the block number of every unknown for the elimination, -1 for the border: offsets,
    tilts, drifts, end nodes, and nodes at which an axis does not move during a pass."""
    group = np.full(columns.count, -1, dtype=np.int64)
    if columns.count <= FEW_UNKNOWNS:
        return group
    node = np.arange(1, columns.nodes + 1)
    folded = np.minimum(node, columns.nodes - node) - 1
    for part in columns.parts:
        for axis in range(3):
            for component in range(3):
                group[columns.of(part, axis, component)] = folded
    standing = layout.approach == 0
    touched = rows.column[:, : 9 * (rows.column.shape[1] // 9)].reshape(len(layout), -1, 3, 3)
    for axis in range(3):
        group[touched[standing[:, axis], :, axis].ravel()] = -1
    if columns.count > columns.miss:
        travels = layout.arrival >= 0
        lower, fraction = between_nodes(layout.volume, layout.position_mm)
        at = np.rint(lower + fraction).astype(np.int64)[travels]
        group[columns.miss + layout.arrival[travels]] = np.maximum(
            np.minimum(at, columns.nodes - at) - 1, 0
        )
    return _merged(group, rows)


def _merged(group: NDArray[np.int64], rows: Rows) -> NDArray[np.int64]:
    touched = np.where(rows.value != 0, group[rows.column], -1)
    highest = touched.max(axis=1)
    lowest = np.where(touched < 0, highest[:, None], touched).min(axis=1)
    stride = max(1, int(np.max(highest - lowest)))
    return np.where(group < 0, -1, group // stride)
