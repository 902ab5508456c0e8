"""Laser and target, set up for a diagonal or a line, with the usual alignment errors."""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.drive.sequence import (
    Box,
    axis_of_run,
    outward_direction,
    outward_stops_mm,
)
from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Stand
from stepdiag.virtual.physics.machine import Machine, Setup
from stepdiag.virtual.physics.optics import (
    Beam,
    CornerCube,
    Figure,
    PlaneMirror,
    Target,
    tilted,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """Alignment errors of a set-up.

    ``mirror_mrad`` tilts the mirror's normal away from the machine's diagonal or axis, and
    ``beam_mrad`` tilts the beam. Both contain a horizontal angle and an upward angle
    (`stepdiag.virtual.physics.optics.perpendiculars`). ``beam_offset_mm`` shifts the beam line from
    the first commanded position. ``target_mm`` is the place of the mirror's pole or the cube's
    vertex in the tool's coordinates. ``standoff_mm`` is the dead path between interferometer and
    target at the first stop.
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
