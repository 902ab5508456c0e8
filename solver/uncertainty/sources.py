"""The sources of uncertainty of a survey, as the patterns that they put on its readings (theory.md 5.3, 5.5, 8.7).

Every assumption is a number with its unit in `Assumptions`, and every source says in words what was assumed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.model.design import rotation_coefficients
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.result.result import ROTATIONS
from stepdiag.solver.standards.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.solver.uncertainty.budget import Source

WAVES = 2
"""Sine waves over the travel, besides the straight part, in the prior of an unmodelled angular function."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """What is taken for granted about machine, laser and hall; standard uncertainties (k = 1), zero switches a source off.

    ``reading_um`` serves where a stop does not bring its own. ``drift_um``: linear drift in one pass; ``wander_um``: what drift that
    is not linear adds up to by its end. ``index``: relative, of the air's index or the laser's wavelength (`solver.standards.air.index_u`).
    ``alignment_mrad``: largest angle between beam and travel. ``angle_urad``: each angular function by name, at the far end of
    its axis; one that was measured gets its own value.
    """

    reading_um: float = 0.3
    repeatability_um: float = 0.2
    drift_um: float = 0.5
    wander_um: float = 0.3
    index: float = 2e-7
    expansion_um_m_c: tuple[float, float, float] = (11.7, 11.7, 11.7)
    u_expansion_um_m_c: float = 1.0
    material_c: tuple[float, float, float] = (20.0, 20.0, 20.0)
    u_material_c: float = 0.3
    alignment_mrad: float = 0.5
    angle_urad: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(ROTATIONS, 10.0))


def sources(layout: Layout, chain: str, assumed: Assumptions) -> tuple[Source, ...]:
    """Return every source with its pattern on the readings of the layout, in the order of its rows."""
    return (
        _reading(layout, assumed),
        _repeatability(layout, assumed),
        _drift(layout, assumed),
        _air(layout, assumed),
        _material(layout, assumed),
        _alignment(layout, assumed),
        _angles(layout, chain, assumed),
    )


def reading_u_um(layout: Layout, assumed: Assumptions) -> Vector:
    """Return the standard uncertainty of every reading by itself, shape (N,)."""
    return np.where(np.isfinite(layout.u_um), layout.u_um, assumed.reading_um)


def _reading(layout: Layout, assumed: Assumptions) -> Source:
    text = f"each stop's own standard uncertainty; {assumed.reading_um:g} um where it brings none"
    return Source(name="reading", text=text, pattern_um=reading_u_um(layout, assumed))


def _repeatability(layout: Layout, assumed: Assumptions) -> Source:
    text = f"the machine comes back to a target within {assumed.repeatability_um:g} um"
    return Source(name="repeatability", text=text, pattern_um=np.full(len(layout), assumed.repeatability_um))


def _drift(layout: Layout, assumed: Assumptions) -> Source:
    """Return a ramp for each out-and-back pair, and a random walk within each pass: what is left when the ramp is known.

    Where a return pass lets the estimate find the ramp, its gain is zero and the ramp costs nothing.
    """
    later = (layout.pass_index[:, None] == layout.pass_index) & (layout.stop[:, None] >= layout.stop)
    walked = later & (layout.stop > 0)
    length = np.maximum(np.bincount(layout.pass_index) - 1, 1)[layout.pass_index]
    walk = walked * assumed.wander_um / np.sqrt(length)[:, None]
    pairs = [(key.setup, (key.number + 1) // 2) for key in layout.passes]
    pair = np.array([list(dict.fromkeys(pairs)).index(found) for found in pairs])[layout.pass_index]
    mine = pair[:, None] == np.unique(pair)
    per_pass = np.where(mine, layout.clock[:, None], 0.0).max(axis=0) / np.array([pairs.count(found) for found in dict.fromkeys(pairs)])
    ramp = mine * assumed.drift_um * layout.clock[:, None] / np.maximum(per_pass, np.finfo(np.float64).tiny)
    text = f"a ramp of {assumed.drift_um:g} um in a pass, and {assumed.wander_um:g} um of wander beside it"
    return Source(name="drift", text=text, pattern_um=np.hstack([ramp, walk]))


def _travel_mm(layout: Layout) -> Vector:
    """Return the commanded travel since the zero of the count, shape (N, 3)."""
    return layout.position_mm - _at_first_stop(layout, layout.position_mm)


def _at_first_stop(layout: Layout, values: Vector) -> Vector:
    zeros, first = np.unique(layout.zero_index, return_index=True)
    at_first: Vector = values[first][np.searchsorted(zeros, layout.zero_index)]
    return at_first


def _air(layout: Layout, assumed: Assumptions) -> Source:
    along_mm = np.sum(_travel_mm(layout) * layout.direction, axis=1)
    text = f"index of air and wavelength known to {assumed.index * 1e6:g} ppm, one error for the whole survey"
    return Source(name="air", text=text, pattern_um=1e3 * assumed.index * along_mm[:, None])


def _material(layout: Layout, assumed: Assumptions) -> Source:
    """Return per axis the effect of its temperature and of its coefficient (theory.md 8.7)."""
    along_m = 1e-3 * _travel_mm(layout) * layout.direction
    excess = np.array(assumed.material_c) - REFERENCE_TEMPERATURE_C
    by_temperature = along_m * np.array(assumed.expansion_um_m_c) * assumed.u_material_c
    by_coefficient = along_m * excess * assumed.u_expansion_um_m_c
    text = f"temperature of each axis known to {assumed.u_material_c:g} C, its coefficient to {assumed.u_expansion_um_m_c:g} um/m/C"
    return Source(name="material temperature", text=text, pattern_um=np.hstack([by_temperature, by_coefficient]))


def _alignment(layout: Layout, assumed: Assumptions) -> Source:
    """Return the cosine error of each setup's beam: always short, at most ``L theta^2 / 2``."""
    along_um = 1e3 * np.sum(_travel_mm(layout) * layout.direction, axis=1)
    root_mean_square = (1e-3 * assumed.alignment_mrad) ** 2 / 2 / np.sqrt(3.0)
    setups = np.unique(layout.setup_index)
    text = f"beam within {assumed.alignment_mrad:g} mrad of the travel, each setup by itself"
    pattern = -root_mean_square * along_um[:, None] * (layout.setup_index[:, None] == setups)
    return Source(name="alignment", text=text, pattern_um=pattern, distribution="one-sided")


def _angles(layout: Layout, chain: str, assumed: Assumptions) -> Source:
    """Return the spot formula (theory.md 4.3) for smooth random angular functions: a straight part and waves of half its size."""
    arm_m = rotation_coefficients(layout, chain)
    columns = [np.zeros((len(layout), 0))]
    for index, name in enumerate(ROTATIONS):
        size = assumed.angle_urad.get(name, 0.0)
        if size > 0.0:
            axis, component = divmod(index, 3)
            columns.append(size * arm_m[:, axis, component, None] * _smooth(layout, axis))
    pattern = np.hstack(columns)
    sizes = sorted({f"{size:g}" for size in assumed.angle_urad.values() if size > 0.0}, key=float)
    text = f"angular functions that are neither solved nor measured: smooth, {' or '.join(sizes) or 'none'} urad at the far end"
    return Source(name="unmodelled angles", text=text, pattern_um=pattern - _at_first_stop(layout, pattern))


def _smooth(layout: Layout, axis: int) -> Vector:
    """Return the shapes of the prior at the axis's position, zero at its low end, shape (N, 1 + WAVES)."""
    along = (layout.position_mm[:, axis] - layout.volume.origin_mm[axis]) / layout.volume.size_mm[axis]
    waves = [np.sin(np.pi * wave * along) / 2 for wave in range(1, WAVES + 1)]
    return np.column_stack([along, *waves])
