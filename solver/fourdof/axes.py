"""Conversion of the 4-DOF head's lateral values to errors of ISO 230-1: straightness EYX .. and
rotations EAX .. of the moved axis."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.solver.standards.straightness import LineMethod, residuals_um

Vector = NDArray[np.float64]
Direction = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """The mounting of the head during a run along ``axis``.

    ``beam`` is the direction of the laser beam from the head; ``detector_x`` and ``detector_y`` are
    the machine directions of the detectors' axes. With the target on the workpiece
    (``target_on="work"``), an error of the machine moves the target in the opposite direction.
    """

    axis: Literal["x", "y", "z"]
    beam: Direction
    detector_x: Direction
    detector_y: Direction
    target_on: Literal["tool", "work"] = "tool"

    def __post_init__(self) -> None:
        if self.beam[1] != self.axis:
            raise UsageError(
                "head: beam",
                expected=message("for-run-along", axis=self.axis),
                found=self.beam,
            )
        if {self.beam[1], self.detector_x[1], self.detector_y[1]} != set(AXES):
            found = f"{self.beam}, {self.detector_x}, {self.detector_y}"
            raise UsageError(
                "head: beam, detector_x, detector_y",
                expected=message("three-different-axes"),
                found=found,
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisErrors:
    """The errors of one axis by ISO 230-1 names: two straightness functions in um and two rotations
    in urad.

    Positions ascend; every value is the mean of the samples at a position. Rotations are zero at
    the first position. Straightness is relative to its reference line. The roll is not measured.
    """

    position_mm: Vector
    straightness_um: dict[str, Vector]
    rotation_urad: dict[str, Vector]


def axis_errors(
    position_mm: Vector,
    straightness_um: Vector,
    angle_urad: Vector,
    mount: Mount,
    line: LineMethod = "end-point",
) -> AxisErrors:
    """Return the machine's errors from a run of the head: axis positions (N,), straightness and
    angle (N, 2) in the detectors' axes.

    A mirror that turns by ``w`` deflects the beam ``b`` by ``2 b x w``, so the head's angle in the
    lateral direction ``e`` is ``(b x w).e``.
    """
    positions, at = np.unique(position_mm, return_inverse=True)
    side = 1.0 if mount.target_on == "tool" else -1.0
    beam = unit(mount.beam)
    straight: dict[str, Vector] = {}
    turning: dict[str, Vector] = {}
    for column, direction in enumerate((mount.detector_x, mount.detector_y)):
        lateral = unit(direction)
        about = np.cross(lateral, beam)
        shift_name = f"E{direction[1].upper()}{mount.axis.upper()}"
        turn_name = f"E{'ABC'[int(np.argmax(np.abs(about)))]}{mount.axis.upper()}"
        shift = _mean_at(at, side * lateral.sum() * straightness_um[:, column])
        turn = _mean_at(at, side * about.sum() * angle_urad[:, column])
        straight[shift_name] = residuals_um(positions, shift, line)
        turning[turn_name] = turn - turn[0]
    return AxisErrors(position_mm=positions, straightness_um=straight, rotation_urad=turning)


def unit(direction: Direction) -> Vector:
    """Return a machine direction as a unit vector, shape (3,)."""
    found = np.zeros(3)
    found[AXES.index(direction[1])] = 1.0 if direction[0] == "+" else -1.0
    return found


def _mean_at(at: NDArray[np.intp], values: Vector) -> Vector:
    mean: Vector = np.bincount(at, weights=values) / np.bincount(at)
    return mean
