"""Laser and target of any line of a plan, for the exact virtual machine: aligned as well as a
person does it."""

import numpy as np

from stepdiag.base.readings.runs import Plan, Run, beam_mm, run_stops_mm
from stepdiag.virtual.physics.machine import Setup
from stepdiag.virtual.physics.optics import Beam, CornerCube, PlaneMirror, tilted

STANDOFF_MM = 300.0


def placed(
    survey: Plan, run: Run, mirror_mrad: tuple[float, float], beam_mrad: tuple[float, float]
) -> Setup:
    """Return a corner cube for a run along one axis, a plane mirror for every other line; mirror
    and beam lean."""
    travel = np.array(run.travel.signs) * np.array(survey.volume.size_mm)
    along = travel / np.linalg.norm(travel)
    linear = run.travel.kind == "linear"
    beam = along if linear else tilted(along, beam_mrad)
    target = (
        CornerCube(np.zeros(3))
        if linear
        else PlaneMirror(np.zeros(3), tilted(along, mirror_mrad), None)
    )
    return Setup(
        name=run.setup,
        beam=Beam(beam_mm(survey, run) - STANDOFF_MM * beam, beam),
        target=target,
        zero_mm=run_stops_mm(survey, run)[0],
    )
