"""The machine whose motors a real control moves: all 21 errors and backlash."""

from dataclasses import replace

import numpy as np

from stepdiag.base.volume import Volume
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine

DIAGONALS = ("ppp", "npp", "pnp", "ppn")
BOX = Volume(origin_mm=(-200.0, -100.0, -160.0), size_mm=(384.0, 192.0, 168.0), increments=8)
MACHINE_ERRORS = Amplitudes(
    positioning_um=5.0,
    straightness_um=5.0,
    angle_urad=10.0,
    scale_um_m=60.0,
    squareness_urad=60.0,
)
LOST_MOTION_UM = 0.3
U_ANGLE_URAD = 1.0


def leaning_machine() -> Machine:
    """Return a machine with all 21 errors and backlash."""
    errors = random_errors(3, BOX.origin_mm, BOX.size_mm, MACHINE_ERRORS)
    backlash = {
        name: lambda position_mm: np.full(len(position_mm), LOST_MOTION_UM)
        for name in ("EXX", "EYY", "EZZ")
    }
    return Machine(errors=replace(errors, reversal=backlash))


def angles_of(machine: Machine) -> str:
    """Return the angles file of an autocollimator that measured every axis at the stops, good to
    `U_ANGLE_URAD`."""
    rng, truth = np.random.default_rng(2), machine.truth(BOX.increments)
    rows = ["axis,position_mm,EA_urad,EB_urad,EC_urad,u_urad"]
    for letter in "XYZ":
        seen = [
            truth.errors[f"E{turn}{letter}"]
            + rng.normal(0.0, U_ANGLE_URAD, BOX.increments + 1)
            for turn in "ABC"
        ]
        for index, at in enumerate(truth.position_mm[letter]):
            values = ",".join(f"{column[index] - column[0]:.4f}" for column in seen)
            rows.append(f"{letter.lower()},{at:g},{values},{U_ANGLE_URAD}")
    return "\n".join([*rows, ""])
