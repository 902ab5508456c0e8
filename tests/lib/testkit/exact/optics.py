"""A ray model of the four-degree-of-freedom head with exact reflections, written without the
equations it checks.

The source pivots at the origin; the beam leaves along ``beam``. The target carries a corner cube
(point reflection about its vertex, direction reversed) and a plane mirror (reflection about its
normal).
"""

from dataclasses import dataclass, field

import numpy as np


def rotation(vector_rad):
    """Return the rotation matrix about ``vector_rad`` by its length (Rodrigues)."""
    angle = np.linalg.norm(vector_rad)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector_rad) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclass
class RayHead:
    """Geometry in mm; ``extra_mm`` is how much farther than the source plane the QD lies."""

    beam: np.ndarray
    lateral_x: np.ndarray
    lateral_y: np.ndarray
    psd1_focal_mm: float = 300.0
    psd2_focal_mm: float = 300.0
    extra_mm: float = 0.0
    vertex_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def shifts_um(
        self, distance_mm, *, shift_mm=(0, 0, 0), turn_urad=(0, 0, 0), pointing_urad=(0, 0)
    ):
        """Return the spot shifts (6,) in um: QD x, y, PSD1 x, y, PSD2 x, y."""
        matrix = rotation(1e-6 * np.asarray(turn_urad, dtype=float))
        ray = self.beam + 1e-6 * (
            pointing_urad[0] * self.lateral_x + pointing_urad[1] * self.lateral_y
        )
        reference = self.beam * distance_mm + np.asarray(shift_mm, dtype=float)
        qd = self._qd(reference + matrix @ self.vertex_mm, ray) - self._qd(
            self.beam * distance_mm + self.vertex_mm, self.beam
        )
        normal = matrix @ -self.beam
        mirrored = ray - 2 * (ray @ normal) * normal
        return np.concatenate(
            [
                1e3 * qd,
                self._focused(-ray, self.psd1_focal_mm),
                self._focused(mirrored, self.psd2_focal_mm),
            ]
        )

    def _qd(self, vertex, ray):
        start = 2 * vertex
        length = (start @ self.beam + self.extra_mm) / (ray @ self.beam)
        return self._lateral(start - length * ray)

    def _focused(self, ray, focal_mm):
        return 1e3 * focal_mm * self._lateral(ray) / abs(ray @ self.beam)

    def _lateral(self, vector):
        return np.array([vector @ self.lateral_x, vector @ self.lateral_y])


def channels_of(shifts_um, *, full_um=5000.0, power=3.0):
    """Return the nine channels of linear detectors: difference over sum is shift over
    ``full_um``."""
    shifts = np.atleast_2d(shifts_um)
    total = np.full(len(shifts), power)
    columns = [
        (power * shifts[:, 2 * i] / full_um, power * shifts[:, 2 * i + 1] / full_um, total)
        for i in range(3)
    ]
    return np.column_stack([column for group in columns for column in group])
