"""The random effects of the adjustment: errors with a known usual size that change many readings
together, for example angles or drift.

Restricted maximum likelihood estimates their sizes from the readings (`solver.linear.components`).
If the readings do not determine a size, the assumed size is used and increases the uncertainty.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.conditions.expansion import REFERENCE_TEMPERATURE_C
from stepdiag.base.messages import Words, message
from stepdiag.base.result.result import ROTATIONS
from stepdiag.base.volume import Vector
from stepdiag.solver.model.design import rotation_coefficients
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.warmth import counted_mm, excess_c

LINE_SHARE, WAVE_SHARE = 0.3, 0.32
"""Standard deviations of an angular function relative to its range: of its straight part at the
far end, and of its first half wave. Half wave k has 1/k of the standard deviation of the first."""
MOST_WAVES = 16
LONG_WAVES = 3
"""Number of half waves whose standard deviation is estimated together with the straight part.
Shorter waves have a separate standard deviation, because the smoothness of guideways is unknown."""
ANGLES, SHORT_ANGLES = "angles", "short waves of angles"
TURNING = (ANGLES, SHORT_ANGLES)
"""Names of the effects that together are the angular functions."""
GROWTH, SETUP_SCALE, FIRST_STOPS = "growth", "setup scale", "first stops"
ONE_SCALE, ONE_WALK, BESIDE = "scale of one setup", "walk of one pass", "beside the model"
BACKLASH = 0.6
"""Initial standard deviation of the backlash at first stops, as a multiple of the repeatability.
With overrun the backlash is zero there; without overrun it is the whole backlash of the axis."""
WANDER_WAVES = 3
BEARING = 0.5
"""Standard deviation of the distance between the fixed bearing of the ball screw and the low
corner of the volume, as a share of the travel."""
LEAST_SCATTER_UM = 0.02
"""Scatter of reported positions below which it is neglected. Positions in steps of 0.1 um
scatter by 0.03 um, which is less than the noise of a laser."""
TIME_CONSTANTS_H = (0.3, 1.0, 3.0)
"""Time constants of thermal growth in hours: a ball screw reaches its final length in minutes, a
column in hours (ISO 230-3 measures for four hours)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Effect:
    """One kind of random effect: ``pattern_um`` (m, k) is the effect of one standard deviation
    of each cause on the readings, ``sought`` is True if its size is estimated, ``text`` is the
    assumption for the report."""

    name: str
    text: Words
    pattern_um: Vector
    sought: bool = False

    @property
    def count(self) -> int:
        return int(self.pattern_um.shape[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AngleShapes:
    """The shapes of unknown angular functions: ``names`` of the functions, and the number of half
    ``waves`` of each function.

    The columns of straight parts and long waves are placed before the columns of short waves,
    because the two groups have separate standard deviations.
    """

    names: tuple[str, ...]
    range_urad: tuple[float, ...]
    waves: int

    def at(self, layout_share: Vector) -> Vector:
        """Return an angular function's straight part and half waves at fractions 0 .. 1 of the
        travel for a range of 1, shape (m, 1 + waves)."""
        number = np.arange(1, self.waves + 1)
        waves = WAVE_SHARE * np.sin(np.pi * number * layout_share[:, None]) / number
        return np.column_stack([LINE_SHARE * layout_share, waves])

    def range_of(self, name: str) -> float:
        return self.range_urad[self.names.index(name)]

    @property
    def long(self) -> int:
        return len(self.names) * (1 + min(self.waves, LONG_WAVES))

    def causes_of(self, name: str) -> NDArray[np.int64]:
        place, long = self.names.index(name), 1 + min(self.waves, LONG_WAVES)
        short = self.waves + 1 - long
        return np.concatenate(
            [place * long + np.arange(long), self.long + place * short + np.arange(short)]
        )


def angle_shapes(
    layout: Layout, known: Mapping[str, object], assumed: Assumptions
) -> AngleShapes:
    """Return the shapes of the angular functions that are not ``known`` and have an assumed
    range."""
    names = tuple(
        name for name in ROTATIONS if name not in known and assumed.angle_range_urad(name) > 0
    )
    waves = min(max(layout.volume.increments - 1, 1), MOST_WAVES)
    return AngleShapes(
        names=names,
        range_urad=tuple(assumed.angle_range_urad(name) for name in names),
        waves=waves,
    )


def effects_of(
    layout: Layout, chain: str, shapes: AngleShapes, assumed: Assumptions
) -> tuple[Effect, ...]:
    """Return every random effect that changes a reading. Angular functions are always included,
    because the machine has angular errors even if no reading depends on them."""
    found = (
        *_angles(layout, chain, shapes),
        _drift(layout, assumed),
        _wander(layout, assumed),
        _setup_scale(layout, assumed),
        _growth(layout, assumed),
        _first_stops(layout, assumed),
        _registers(layout),
        _survey_scale(layout, assumed),
        _material(layout, assumed),
    )
    return tuple(
        effect
        for effect in found
        if effect.count and (effect.name in TURNING or np.any(effect.pattern_um))
    )


def _angles(layout: Layout, chain: str, shapes: AngleShapes) -> tuple[Effect, Effect]:
    """Return the effects of the unknown angular functions (theory 4.3): one for straight parts and
    long waves, one for short waves.

    The readings show short waves best. With a common standard deviation, the estimate of the long
    waves would be too small for a machine without short waves.
    """
    arms = rotation_coefficients(layout, chain)
    pattern = np.zeros((len(layout), len(shapes.names) * (shapes.waves + 1)))
    for name, size in zip(shapes.names, shapes.range_urad, strict=True):
        axis, component = divmod(ROTATIONS.index(name), 3)
        share = (
            layout.position_mm[:, axis] - layout.volume.origin_mm[axis]
        ) / layout.volume.length_mm[axis]
        pattern[:, shapes.causes_of(name)] = (
            size * arms[:, axis, component, None] * shapes.at(share)
        )
    text = message(
        "assumed-angles", sizes=[f"{size:g}" for size in sorted(set(shapes.range_urad))]
    )
    short = message("assumed-short-angles", number=LONG_WAVES + 1)
    return (
        Effect(name=ANGLES, text=text, pattern_um=pattern[:, : shapes.long], sought=True),
        Effect(
            name=SHORT_ANGLES, text=short, pattern_um=pattern[:, shapes.long :], sought=True
        ),
    )


def _elapsed(layout: Layout) -> Vector:
    elapsed = np.zeros(len(layout))
    for number in np.unique(layout.offset_index):
        mine = np.flatnonzero(layout.offset_index == number)
        passes = len(np.unique(layout.pass_index[mine]))
        elapsed[mine] = np.arange(len(mine)) * passes / max(len(mine) - 1, 1)
    return elapsed


def _by(index: NDArray[np.int64], values: Vector) -> Vector:
    apart: Vector = values[:, None] * (index[:, None] == np.unique(index))
    return apart


def _first_of(index: NDArray[np.int64]) -> NDArray[np.int64]:
    _, first, member = np.unique(index, return_index=True, return_inverse=True)
    return np.asarray(first[member])


def _drift(layout: Layout, assumed: Assumptions) -> Effect:
    pattern = assumed.drift_um * _by(layout.offset_index, _elapsed(layout))
    return Effect(
        name="drift",
        text=message("assumed-drift", drift_um=assumed.drift_um),
        pattern_um=pattern,
        sought=True,
    )


def _wander(layout: Layout, assumed: Assumptions) -> Effect:
    """Return the effect of a random walk of the laser in each unbroken count, by the largest
    terms of its Karhunen-Loeve expansion."""
    elapsed = _elapsed(layout)
    longest = np.zeros(int(layout.offset_index.max()) + 1)
    np.maximum.at(longest, layout.offset_index, elapsed)
    whole = longest[layout.offset_index]
    turns = np.pi * (np.arange(WANDER_WAVES) + 0.5)
    waves = [
        np.sqrt(2.0 * whole) * np.sin(turn * elapsed / np.maximum(whole, 1e-9)) / turn
        for turn in turns
    ]
    pattern = assumed.wander_um * np.hstack(
        [_by(layout.offset_index, wave) for wave in waves]
    )
    text = message("assumed-wander", wander_um=assumed.wander_um)
    return Effect(name="wander", text=text, pattern_um=pattern, sought=True)


def travel_mm(layout: Layout) -> Vector:
    """Return the commanded travel from the low corner of the volume, along each reading's
    direction, shape (m, 3)."""
    return (layout.position_mm - layout.volume.origin_mm) * layout.direction


def _setup_scale(layout: Layout, assumed: Assumptions) -> Effect:
    """Return the effect of a scale error of each setup: unmeasured changes of temperature and
    air, and the cosine error of the beam."""
    coefficient = float(np.mean(assumed.expansion_um_m_c))
    cosine_um_m = 0.5 * assumed.alignment_mrad**2 / np.sqrt(3.0)
    size_um_m = float(
        np.linalg.norm(
            [coefficient * assumed.setup_c, 1e6 * assumed.index_setup, cosine_um_m]
        )
    )
    along_m = 1e-3 * np.sum(travel_mm(layout), axis=1)
    text = message(
        "assumed-setup-scale",
        warm_c=assumed.setup_c,
        air_ppm=1e6 * assumed.index_setup,
        beam_mrad=assumed.alignment_mrad,
        size_um_m=size_um_m,
    )
    return Effect(
        name=SETUP_SCALE,
        text=text,
        pattern_um=size_um_m * _by(layout.setup_index, along_m),
        sought=True,
    )


def _growth(layout: Layout, assumed: Assumptions) -> Effect:
    """Return the effect of the thermal growth of each axis during the survey, as exponentials in
    time.

    For each time constant an axis has one column for its length and one for the position of the
    fixed bearing of its ball screw. The effect has no columns if a reading has no time, because
    growth cannot then be separated from the scales of the setups.
    """
    waves = growth_waves(layout)
    beside_m = BEARING * 1e-3 * np.array(layout.volume.size_mm) * layout.direction
    along_m = np.concatenate([1e-3 * travel_mm(layout), beside_m], axis=1)
    pattern = assumed.growth_um_m * (along_m[:, :, None] * waves[:, None, :]).reshape(
        len(layout), -1
    )
    text = message("assumed-growth", growth_um_m=assumed.growth_um_m)
    return Effect(name=GROWTH, text=text, pattern_um=pattern, sought=True)


def growth_waves(layout: Layout) -> Vector:
    """Return exponentials in time minus their means, shape (m, time constants), without columns
    if a reading has no time."""
    hours = layout.hours
    if not len(layout) or not np.all(np.isfinite(hours)) or np.ptp(hours) == 0.0:
        return np.zeros((len(layout), 0))
    waves = np.exp(-(hours - np.min(hours))[:, None] / np.array(TIME_CONSTANTS_H)) / np.sqrt(
        len(TIME_CONSTANTS_H)
    )
    centred: Vector = waves - np.mean(waves, axis=0)
    return centred


def _first_stops(layout: Layout, assumed: Assumptions) -> Effect:
    """Return the effect of each axis' backlash at the stops before the first move of the axis in
    a pass. Without overrun these stops differ from all later stops by the backlash."""
    begins = _first_of(layout.pass_index)
    # after a reversal without overrun, the last move belongs to the previous pass
    came = (begins == 0)[:, None] | (
        layout.arrival[begins] != layout.arrival[np.maximum(begins - 1, 0)]
    )
    still = came & (layout.arrival == layout.arrival[begins]) & (layout.arrival >= 0)
    size_um = BACKLASH * assumed.repeatability_um
    pattern = -size_um * layout.direction * layout.approach * still
    text = message("assumed-first-stops", size_um=size_um)
    return Effect(name=FIRST_STOPS, text=text, pattern_um=pattern, sought=True)


def _registers(layout: Layout) -> Effect:
    """Return the effect of reported positions that scatter although the machine stands still.

    The deviation of a reading is relative to the reported position, so a scatter of the reported
    position adds an error. The effect has two patterns: the scatter of a standing axis within its
    stay between two moves, and the scatter of the mean positions from stay to stay. The amount of a
    pattern is 0 if the axis really was at the reported position, and 1 if only the reported value
    scatters. Rounding that repeats at each target, or that accumulates over increments, is not
    scatter.
    """
    within, between = np.zeros_like(layout.beside_mm), np.zeros_like(layout.beside_mm)
    for axis in range(3):
        stands = np.where(
            layout.arrival[:, axis] < 0, -1 - layout.pass_index, layout.arrival[:, axis]
        )
        stay = np.unique(stands, return_inverse=True)[1]
        scatter = _beside_program_mm(layout, axis)
        between[:, axis] = (np.bincount(stay, weights=scatter) / np.bincount(stay))[stay]
        within[:, axis] = scatter - between[:, axis]
    pattern = -1e3 * np.column_stack(
        [np.sum(each * layout.direction, axis=1) for each in (within, between)]
    )
    pattern = (
        pattern[:, np.sqrt(np.mean(pattern**2, axis=0)) > LEAST_SCATTER_UM]
        if len(layout)
        else pattern[:, :0]
    )
    return Effect(name="registers", text=message("assumed-registers"), pattern_um=pattern)


def _beside_program_mm(layout: Layout, axis: int) -> Vector:
    """Return the reported positions minus the targets in mm, shape (m,), without the mean at each
    target and without accumulated rounding of increments.

    Equal increments are rounded equally. The accumulated rounding is therefore proportional to the
    distance from the first stop of the pass. If each pass begins where the previous pass ended, it
    is proportional to the distance from the first stop of the setup.
    """
    beside, targets, passes = (
        layout.beside_mm[:, axis],
        layout.position_mm[:, axis],
        layout.pass_index,
    )
    if not np.any(beside):
        return np.zeros_like(beside)
    many = np.array(
        [len(np.unique(targets[passes == number])) for number in range(len(layout.passes))]
    )[passes]
    ways = [targets - targets[_first_of(index)] for index in (passes, layout.setup_index)]
    program = np.hstack(
        [np.equal.outer(targets, np.unique(targets)), *(_by(many, way) for way in ways)]
    )
    return np.asarray(beside - program @ np.linalg.lstsq(program, beside, rcond=None)[0])


def _survey_scale(layout: Layout, assumed: Assumptions) -> Effect:
    along_m = 1e-3 * np.sum(travel_mm(layout), axis=1)
    text = message("assumed-air", index_ppm=assumed.index * 1e6)
    return Effect(name="air", text=text, pattern_um=1e6 * assumed.index * along_m[:, None])


def _material(layout: Layout, assumed: Assumptions) -> Effect:
    """Return the effects of the material temperature and the expansion coefficient of each axis
    on readings reduced to 20 C (theory 8.7). The coefficient also affects readings reduced to
    the mean temperature of the survey."""
    along_m = 1e-3 * travel_mm(layout) * float(assumed.reduced_to_20_c)
    excess = np.array(assumed.material_c) - REFERENCE_TEMPERATURE_C
    by_temperature = along_m * np.array(assumed.expansion_um_m_c) * assumed.u_material_c
    levelled = 1e-3 * counted_mm(layout) * excess_c(layout, assumed)[:, None]
    by_coefficient = (along_m * excess + levelled) * assumed.u_expansion_um_m_c
    text = message(
        "assumed-material", u_c=assumed.u_material_c, u_um_m_c=assumed.u_expansion_um_m_c
    )
    return Effect(
        name="material temperature",
        text=text,
        pattern_um=np.hstack([by_temperature, by_coefficient]),
    )
