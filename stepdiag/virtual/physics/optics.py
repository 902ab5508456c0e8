"""Beam, plane mirror and corner cube: the exact path of a ray (theory 4.1)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stepdiag.virtual.physics.error_functions import Array
from stepdiag.virtual.physics.kinematics import Pose


@dataclass(frozen=True, slots=True)
class Beam:
    """A ray from ``source_mm`` along the unit vector ``direction``, both shape (3,)."""

    source_mm: Array
    direction: Array


class Target(Protocol):
    """A target that reflects the beam and moves with the tool."""

    def distance_mm(self, pose: Pose, beam: Beam) -> Array:
        """Return half the length of the optical path out and back, shape (N,)."""
        ...


@dataclass(frozen=True, slots=True)
class Figure:
    """Deviation of a mirror's face from a plane, as a smooth map over its diameter; ``peak_um`` is
    the largest height."""

    peak_um: float
    diameter_mm: float
    seed: int

    def height_mm(self, across_mm: Array, up_mm: Array) -> Array:
        """Return the height of the mirror's face at points of the mirror, shape (N,)."""
        rng = np.random.default_rng(self.seed)
        height = np.zeros_like(across_mm)
        total = 0.0
        for _ in range(4):
            waves_across, waves_up, phase, weight = rng.uniform(
                (-2, -2, 0, 0.3), (2, 2, 2 * np.pi, 1.0)
            )
            height += weight * np.sin(
                np.pi / self.diameter_mm * (waves_across * across_mm + waves_up * up_mm)
                + phase
            )
            total += weight
        scaled: Array = height * (self.peak_um * 1e-3 / total)
        return scaled


def perpendiculars(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that make a right-handed frame with ``direction``. The first vector
    is horizontal (X for a vertical beam), the second vector points upward."""
    level = np.cross([0.0, 0.0, 1.0], direction)
    if np.linalg.norm(level) < 1e-9:
        level = np.array([1.0, 0.0, 0.0])
    level = level / np.linalg.norm(level)
    return level, np.cross(direction, level)


def tilted(direction: Array, tilt_mrad: tuple[float, float]) -> Array:
    """Return the unit vector ``direction`` tilted by ``tilt_mrad`` towards its two
    `perpendiculars`, shape (3,)."""
    level, up = perpendiculars(direction)
    leaning = direction + 1e-3 * (tilt_mrad[0] * level + tilt_mrad[1] * up)
    unit: Array = leaning / np.linalg.norm(leaning)
    return unit


@dataclass(frozen=True, slots=True)
class PlaneMirror:
    """A flat mirror in the spindle: ``pole_mm`` and ``normal`` in the tool's coordinates; the
    normal points along the beam."""

    pole_mm: Array
    normal: Array
    figure: Figure | None = None

    def distance_mm(self, pose: Pose, beam: Beam) -> Array:
        """Return the distance at which the ray meets the mirror's plane, L = n.(P - S) / (n.u),
        including the height of the face, shape (N,)."""
        normal = pose.vector(self.normal)
        pole = pose.point_mm(self.pole_mm)
        incidence = normal @ beam.direction
        distance: Array = np.einsum("ni,ni->n", normal, pole - beam.source_mm) / incidence
        if self.figure is None:
            return distance
        spot = pose.local(beam.source_mm + distance[:, None] * beam.direction - pole)
        level, up = perpendiculars(self.normal)
        standing_out: Array = self.figure.height_mm(spot @ level, spot @ up) / incidence
        return distance + standing_out


@dataclass(frozen=True, slots=True)
class CornerCube:
    """A corner cube with its apparent vertex at ``vertex_mm`` in the tool's coordinates."""

    vertex_mm: Array

    def distance_mm(self, pose: Pose, beam: Beam) -> Array:
        """Return the distance of the vertex along the beam, shape (N,): a corner cube returns the
        ray parallel, whatever its attitude."""
        distance: Array = (pose.point_mm(self.vertex_mm) - beam.source_mm) @ beam.direction
        return distance
