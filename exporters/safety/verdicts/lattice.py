"""Verdicts on a lattice, function by function. The correction of the lattice is separated into
curves (means over the other two axes) and products (parts proportional to a lever).

The curves and products are the best tables for the lattice (`tables.fit`), so they are judged like
tables.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from stepdiag.base.findings import Finding, error
from stepdiag.base.names import AXES
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume, rms
from stepdiag.exporters.profiles.file import quick_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.standing import NOTHING_UM, Standing, identifies, slope_lost
from stepdiag.exporters.safety.verdicts.judge import judge
from stepdiag.exporters.safety.verdicts.regression import SURE_UM
from stepdiag.exporters.safety.verdicts.verdict import Judgement
from stepdiag.exporters.safety.verdicts.wanted import growing_um
from stepdiag.exporters.tables.curves import FUNCTIONS
from stepdiag.exporters.tables.lattice import NAME
from stepdiag.exporters.tables.tables import Law, Multiplier, Table

_LAW = Law(sense="as-compensation")
_QUANTUM_UM = 1e-3

Moved = Callable[[Vector], Vector]
Axes = tuple[Vector, Vector, Vector]


def judge_lattice(result: Result, moved_um: Moved, axes_mm: Axes) -> tuple[Judgement, ...]:
    """Return a judgement for every function and every product in the correction of a lattice with
    the axes ``axes_mm``.

    Unmeasured angles count with their expected values, as in the lattice.
    """
    parts = parts_of(moved_um, axes_mm, result.volume)
    # The judgement of a lattice needs no profile, so it uses the neutral control.
    stand_in = quick_profile(controller_named("neutral"), result.volume)
    known = replace(result, errors={**result.errors, **result.expected})
    return judge(known, parts, Standing(after=parts, new=parts), stand_in)


def parts_of(moved_um: Moved, axes_mm: Axes, volume: Volume) -> tuple[Table, ...]:
    """Return the correction of a lattice as tables: a curve for each of the nine functions in
    order, then the parts that grow with a lever.
    """
    return (
        *(
            _curve(name, moved_um, axes_mm["XYZ".index(name[2])], volume)
            for name in FUNCTIONS
        ),
        *_products(moved_um, volume),
    )


def lost_in_field(result: Result, moved_um: Moved) -> Iterator[Finding]:
    """Yield the losses if a correction of the whole field replaces the old correction ``moved_um``,
    which was off during the measurement.

    The loss is an error if the result does not identify a function of the old correction. The loss
    is a warning if the result identifies the function without its slope.
    """
    volume = result.volume
    for name in FUNCTIONS:
        old = _curve(name, moved_um, volume.nodes_mm("XYZ".index(name[2])), volume)
        held_um = float(np.ptp(old.value_um))
        if held_um > NOTHING_UM and not result.knows(name):
            yield error("old-table-lost.lattice", name=name, um=held_um)
        elif not identifies(result, old):
            yield from slope_lost(old, [old])


def _curve(name: str, moved_um: Moved, at_mm: Vector, volume: Volume) -> Table:
    """Return the mean movement of an output axis over the volume, at positions along the input
    axis.

    A lattice, like a table, is judged only at its own points.
    """
    output, moving = (AXES.index(letter.lower()) for letter in name[1:])
    along = [volume.nodes_mm(axis) for axis in range(3)]
    along[moving] = at_mm
    points = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    moved = moved_um(points.reshape(-1, 3))[:, output].reshape(points.shape[:3])
    mean = np.mean(moved, axis=tuple({0, 1, 2} - {moving}))
    return _lattice_table(name, at_mm, mean - mean[0])


def _products(moved_um: Moved, volume: Volume) -> Iterator[Table]:
    for output, (moving, by) in product("XYZ", permutations(range(3), 2)):
        name, at = f"E{output}{'XYZ'[moving]}", volume.nodes_mm(moving)
        grown = growing_um(moved_um, volume, f"{name}*{'XYZ'[by]}")
        if moving > by:
            # A bilinear movement is proportional to both axes and would give two products.
            # The second product is left out.
            even = np.linspace(-1.0, 1.0, len(at))
            grown = grown - even * float(np.mean(even * grown)) / rms(even) ** 2
        if rms(grown) > SURE_UM / 2:
            ends = volume.even_mm(by, 2)
            lever = Multiplier(axis="XYZ"[by], position_mm=ends, value=np.array([-1.0, 1.0]))
            yield _lattice_table(name, at, grown, lever)


def _lattice_table(
    name: str, position_mm: Vector, value_um: Vector, multiplier: Multiplier | None = None
) -> Table:
    return Table(
        kind=NAME,
        input_axis=name[2],
        output_axis=name[1],
        position_mm=position_mm,
        value_um=value_um,
        quantum_um=_QUANTUM_UM,
        law=_LAW,
        reference_mm=float(position_mm[0]),
        multiplier=multiplier,
    )
