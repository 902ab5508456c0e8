"""The independent comparison: a real control drives a grid that no survey touched, and the true
error of the tool is taken there."""

import numpy as np

from stepdiag.base.result.field import without_rigid_motion
from stepdiag.base.volume import Volume
from stepdiag.virtual.physics.machine import Machine
from testkit.linuxcnc.rig import Control
from testkit.linuxcnc.standing import stands

ATTEMPTS = 5
APART = ((0.06, 0.77), (0.19, 0.93), (0.06, 0.77))
"""Where the grid lies in the volume, along each axis: at no stop of the survey."""


def driven_rms_um(control: Control, machine: Machine, volume: Volume) -> float:
    """Return the true error of the tool, rms without rigid motion, on a grid that no survey
    touched."""
    steps = [
        [low + share * size for share in shares]
        for shares, low, size in zip(APART, volume.origin_mm, volume.size_mm, strict=True)
    ]
    points = np.array([(x, y, z) for x in steps[0] for y in steps[1] for z in steps[2]])
    left: dict[int, np.ndarray] = {}
    for _ in range(ATTEMPTS):
        missing = [number for number in range(len(points)) if number not in left]
        left |= driven_um(control, machine, points, missing)
        if len(left) == len(points):
            errors = np.array([left[number] for number in range(len(points))])
            return float(
                np.sqrt(
                    np.mean(np.sum(without_rigid_motion(volume, points, errors) ** 2, axis=1))
                )
            )
    raise AssertionError(
        f"the rig was told of {len(left)} of {len(points)} stops in {ATTEMPTS} attempts"
    )


def driven_um(
    control: Control, machine: Machine, points: np.ndarray, numbers: list[int]
) -> dict[int, np.ndarray]:
    """Return the error vector at each of the numbered points that the rig saw the control stand at;
    it may look away on a busy computer."""
    lines = ["G21 G90 G61.1"]
    for number in numbers:
        x, y, z = points[number]
        lines += [
            f"G53 G1 X{x:.6f} Y{y:.6f} Z{z:.6f} F90000",
            f"M68 E1 Q{number + 1}",
            "M64 P0",
            "G4 P0.08",
            "M65 P0",
        ]
    direction, last = np.zeros(3), np.array(control.state.commanded_mm)
    ways = {}
    for number in numbers:
        moved = points[number] - last
        direction = np.where(np.abs(moved) > 1e-3, np.sign(moved), direction)
        ways[number], last = direction, points[number]
    seen = {
        state.count - 1: state
        for state in stands(control, "\n".join([*lines, "M2", ""]).encode("ascii"))
    }
    return {
        number: (
            machine.pose(np.array([seen[number].motor_mm]), direction=ways[number]).origin_mm[
                0
            ]
            - points[number]
        )
        * 1e3
        for number in numbers
        if number in seen
    }
