"""Exact rigid-body kinematics: rotation matrices composed along the chain, without linearisation.

A chain is written from the workpiece to the tool with ``F`` for the foundation (ISO 10791-6 style):
``FXYZ`` is [w b X Y Z t], ``XYFZ`` is [w X' Y' b Z t]; axes left of ``F`` carry the work. Every
error is the tool's error relative to the work. So the angles of a carriage on the work side also
turn the travel of this carriage. The angles of a carriage on the tool side do not turn its travel.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.virtual.physics.error_functions import AXES, Array

Stand = Literal["table", "floor"]


@dataclass(frozen=True, slots=True)
class Pose:
    """Frames with their places and rotations: ``origin_mm`` (N, 3), ``rotation`` (N, 3, 3)."""

    origin_mm: Array
    rotation: Array

    def moved(self, offset_mm: Array) -> "Pose":
        """Return the frame shifted by ``offset_mm`` (N, 3) or (3,) in its own coordinates."""
        return Pose(self.point_mm(offset_mm), self.rotation)

    def turned(self, rotation: Array) -> "Pose":
        """Return the frame turned by ``rotation`` (N, 3, 3) about its own origin."""
        return Pose(self.origin_mm, self.rotation @ rotation)

    def point_mm(self, local_mm: Array) -> Array:
        """Return the place of a point of the frame in the outer coordinates, shape (N, 3)."""
        return self.origin_mm + self.vector(local_mm)

    def vector(self, local: Array) -> Array:
        """Return a direction of the frame in the outer coordinates, shape (N, 3)."""
        broadcast = np.broadcast_to(local, self.origin_mm.shape)
        turned: Array = np.einsum("nij,nj->ni", self.rotation, broadcast)
        return turned

    def local(self, outer: Array) -> Array:
        """Return an outer direction in the coordinates of the frame, shape (N, 3)."""
        broadcast = np.broadcast_to(outer, self.origin_mm.shape)
        turned: Array = np.einsum("nji,nj->ni", self.rotation, broadcast)
        return turned


def rotation_matrix(angles_rad: Array) -> Array:
    """Return the rotation matrices of the vectors ``angles_rad`` (N, 3), shape (N, 3, 3): the
    direction of a vector is the axis, its length the angle (Rodrigues)."""
    angle = np.linalg.norm(angles_rad, axis=-1)[:, None, None]
    cross = np.zeros((len(angles_rad), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2] = -angles_rad[:, 2], angles_rad[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = angles_rad[:, 2], -angles_rad[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = -angles_rad[:, 1], angles_rad[:, 0]
    turned: Array = (
        np.eye(3)
        + np.sinc(angle / np.pi) * cross
        + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )
    return turned


def split_chain(chain: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the axes on the work side and on the tool side, each in the order of the chain.

    Raises ValueError unless ``chain`` contains F, X, Y and Z once each.
    """
    if sorted(chain) != ["F", "X", "Y", "Z"]:
        raise ValueError(
            f"chain: expected F, X, Y, Z once each from workpiece to tool, found {chain!r}"
        )
    work, tool = chain.split("F")
    return tuple(AXES.index(letter) for letter in work), tuple(
        AXES.index(letter) for letter in tool
    )


def tool_pose(
    chain: str,
    travel_mm: Array,
    displacement_um: list[Array],
    rotation_urad: list[Array],
    stand: Stand = "table",
) -> Pose:
    """Return the frame at the end of the chain, viewed from the workpiece table or from the floor.

    ``travel_mm`` (N, 3) is counted from the point to which the errors refer; ``displacement_um``
    and ``rotation_urad`` contain one array (N, 3) per axis. Viewed from the floor, the axes that
    carry the work have no effect.
    """
    work, tool = split_chain(chain)
    count = len(travel_mm)
    pose = Pose(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)))
    for axis in work if stand == "table" else ():
        pose = pose.moved(displacement_um[axis] * 1e-3).turned(
            rotation_matrix(rotation_urad[axis] * 1e-6)
        )
        pose = pose.moved(_along(axis, travel_mm))
    for axis in tool:
        pose = pose.moved(_along(axis, travel_mm) + displacement_um[axis] * 1e-3)
        pose = pose.turned(rotation_matrix(rotation_urad[axis] * 1e-6))
    return pose


def _along(axis: int, travel_mm: Array) -> Array:
    step = np.zeros_like(travel_mm)
    step[:, axis] = travel_mm[:, axis]
    return step
