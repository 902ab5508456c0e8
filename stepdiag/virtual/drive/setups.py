"""Laser and target set up for a diagonal or a line, aligned as well as a person does it."""

from dataclasses import dataclass, field

import numpy as np

from stepdiag.virtual.drive.arrivals import (
    PositionRegisters,
    Scatter,
    Standing,
    arrivals,
    standing_at_end,
)
from stepdiag.virtual.drive.sequence import (
    Box,
    axis_of_run,
    driven_pass,
    outward_direction,
    outward_stops_mm,
)
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Stand
from stepdiag.virtual.physics.machine import Machine, Setup
from stepdiag.virtual.physics.optics import Beam, CornerCube, Figure, PlaneMirror, Target, tilted


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """Imperfections of a set-up.

    ``mirror_mrad`` leans the mirror's normal and ``beam_mrad`` the beam away from the machine's
    diagonal or axis, each towards the level and the upright perpendicular of this direction.
    ``beam_offset_mm`` shifts the beam line from the first commanded position; ``target_mm`` is the
    place of the mirror's pole or the cube's vertex in the tool's coordinates. ``standoff_mm`` is
    the dead path between interferometer and target at the first stop.
    """

    mirror_mrad: tuple[float, float] = (0.0, 0.0)
    beam_mrad: tuple[float, float] = (0.0, 0.0)
    beam_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    target_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    flatness_um: float = 0.0
    mirror_diameter_mm: float = 100.0
    flatness_seed: int = 1
    standoff_mm: float = 300.0
    stand: Stand = "table"
    assumed_index: float | None = None
    wavelength_nm: float = 632.991


def aligned_setup(
    machine: Machine, box: Box, setup: str, alignment: Alignment | None = None
) -> Setup:
    """Return the set-up of a diagonal (plane mirror) or of a run along one axis (corner cube)."""
    how = alignment or Alignment()
    axis = axis_of_run(setup)
    direction = outward_direction(box, setup)
    start = outward_stops_mm(box, setup)[0]
    through = start + machine.tool_offset_mm + how.beam_offset_mm
    if axis is not None:
        through = through + how.target_mm
    beam_direction = tilted(direction, how.beam_mrad)
    return Setup(
        name=setup,
        beam=Beam(through - how.standoff_mm * beam_direction, beam_direction),
        target=_mirror(direction, how)
        if axis is None
        else CornerCube(np.array(how.target_mm, dtype=np.float64)),
        zero_mm=start,
        stand=how.stand,
        wavelength_nm=how.wavelength_nm,
        assumed_index=how.assumed_index,
    )


def _mirror(direction: Array, how: Alignment) -> Target:
    figure = (
        Figure(how.flatness_um, how.mirror_diameter_mm, how.flatness_seed)
        if how.flatness_um
        else None
    )
    return PlaneMirror(
        np.array(how.target_mm, dtype=np.float64), tilted(direction, how.mirror_mrad), figure
    )


@dataclass(frozen=True, slots=True)
class SimulatedPass:
    """The readings of a pass as columns: positions (by the registers) and readings in mm, relative
    to the pass's first stop.

    ``first_mm`` is the count at the first stop: passes of a set-up with an unbroken beam share its
    zero. ``end`` is the place of the axes after the pass.
    """

    setup: str
    number: int
    stop: np.ndarray[tuple[int], np.dtype[np.int64]]
    position_mm: Array
    reading_mm: Array
    time_s: Array
    temperature_c: Array
    beam_mm: Array
    first_mm: float
    end: Standing


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of a pass.

    White noise of ``noise_um`` (standard deviation) on each reading, drawn by ``seed``, and the
    time. ``scatter`` is the scatter of the axes about their targets, ``registers`` the control's
    display of the position. ``before`` is the place of the axes before the pass, ``overrun``
    whether they come to its first stop in the direction of the pass
    (`stepdiag.virtual.drive.arrivals`).
    """

    noise_um: float = 0.0
    seed: int = 0
    start_s: float = 0.0
    seconds_per_stop: float = 10.0
    scatter: Scatter = field(default_factory=Scatter)
    registers: PositionRegisters = field(default_factory=PositionRegisters)
    before: Standing | None = None
    overrun: bool = True


def simulate_pass(
    machine: Machine,
    box: Box,
    setup: str,
    number: int = 1,
    *,
    alignment: Alignment | None = None,
    conditions: Conditions | None = None,
    axis_order: str = "xyz",
) -> SimulatedPass:
    """Measure one pass without servers, at ideal stops."""
    how = alignment or Alignment()
    taken = conditions or Conditions()
    placed = aligned_setup(machine, box, setup, how)
    driven = driven_pass(box, setup, number, axis_order)
    times: Array = taken.start_s + taken.seconds_per_stop * np.arange(
        len(driven.stop_mm), dtype=np.float64
    )
    drawing = np.random.default_rng((taken.seed, 1))
    came = arrivals(driven, taken.scatter, drawing, before=taken.before, overrun=taken.overrun)
    indicated = machine.indicated_mm(
        placed, driven.stop_mm + came.off_mm, direction=came.side, time_s=times
    )
    noisy = indicated + np.random.default_rng(taken.seed).normal(
        scale=taken.noise_um * 1e-3, size=len(times)
    )
    return SimulatedPass(
        setup=setup,
        number=number,
        stop=np.arange(len(times), dtype=np.int64),
        position_mm=taken.registers.shown_mm(driven.stop_mm, came.servo_um, drawing),
        reading_mm=noisy - noisy[0],
        time_s=times,
        temperature_c=machine.environment.material_c.at(times),
        beam_mm=np.broadcast_to(placed.zero_mm + how.beam_offset_mm, driven.stop_mm.shape),
        first_mm=float(noisy[0]),
        end=standing_at_end(driven, came),
    )
