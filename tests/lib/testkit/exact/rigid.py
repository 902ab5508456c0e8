"""A machine of random errors that drives a planned survey: rigid bodies, a mirror plane and a ray,
no formula of the solver.

Chain FXYZ, arms from the low corner of the volume: ``E(P) = sum_a [delta_a(a) + alpha_a(a) x r_a]``
with r_x = (0, y, z), r_y = (0, 0, z), r_z = 0. The laser reads ``L = n.(P - S) / (n.u)`` on a
mirror, the length along its beam on a retroreflector.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.base.readings.runs import Plan, perfect_readings
from stepdiag.base.setups import setup_of

ARMS = np.array([[0, 1, 1], [0, 0, 1], [0, 0, 0]])
SHEARS = {"C0Y": (0, 1, -1.0), "B0Z": (0, 2, 1.0), "A0Z": (1, 2, -1.0)}


@dataclass(frozen=True, kw_only=True)
class RandomMachine:
    """Errors by axis (first index) and component: waves vanish at both ends of the travel, slopes
    do not. um, um/m, urad."""

    size_mm: np.ndarray
    waves_um: np.ndarray
    slopes: np.ndarray
    angle_line_urad: np.ndarray
    angle_waves_urad: np.ndarray

    @classmethod
    def draw(cls, rng, size_mm, *, angle_urad=10.0):
        """Draw a machine: waves of 5 µm, squareness of 20 urad, scales of 15 µm/m, angles as in the
        solver's prior."""
        slopes = np.diag(rng.normal(0, 15, 3))
        slopes[1, 0], slopes[2, 0], slopes[2, 1] = rng.normal(0, 20, 3)
        return cls(
            size_mm=np.asarray(size_mm, dtype=float),
            waves_um=rng.normal(0, 5, (3, 3, 3)),
            slopes=slopes,
            angle_line_urad=rng.normal(0, angle_urad, (3, 3)),
            angle_waves_urad=rng.normal(0, angle_urad / 2, (3, 3, 2)),
        )

    def displacement_um(self, axis, component, at_mm):
        """Return one displacement function at positions from the low corner."""
        along = at_mm / self.size_mm[axis]
        waves = sum(
            size * np.sin(np.pi * (k + 1) * along)
            for k, size in enumerate(self.waves_um[axis, component])
        )
        return waves + 1e-3 * self.slopes[axis, component] * at_mm

    def angle_urad(self, axis, component, at_mm):
        """Return one rotation function at positions from the low corner."""
        along = at_mm / self.size_mm[axis]
        waves = sum(
            size * np.sin(np.pi * (k + 1) * along)
            for k, size in enumerate(self.angle_waves_urad[axis, component])
        )
        return waves + self.angle_line_urad[axis, component] * along

    def pose(self, points_mm):
        """Return the tool's errors at commanded points (N, 3): displacement in mm and rotation in
        rad, shapes (N, 3)."""
        error, turned = np.zeros_like(points_mm), np.zeros_like(points_mm)
        for axis in range(3):
            at = points_mm[:, axis]
            turn = (
                np.column_stack(
                    [self.angle_urad(axis, component, at) for component in range(3)]
                )
                * 1e-6
            )
            error += (
                np.column_stack(
                    [self.displacement_um(axis, component, at) for component in range(3)]
                )
                * 1e-3
            )
            error += np.cross(turn, ARMS[axis] * points_mm)
            turned += turn
        return error, turned

    def truth(self, name, node, increments):
        """Return the true value of a quantity by the solver's name: shape at a node, squareness in
        urad, scale in um/m."""
        if name in SHEARS:
            component, axis, sign = SHEARS[name]
            return sign * (self.slopes[axis, component] + self.slopes[component, axis])
        if len(name) == 1:
            return self.slopes["XYZ".index(name), "XYZ".index(name)]
        axis, component = "XYZ".index(name[2]), "XYZ".index(name[1])
        at = self.size_mm[axis] * node / increments
        return (
            self.displacement_um(axis, component, at)
            - 1e-3 * self.slopes[axis, component] * at
        )


@dataclass(frozen=True, kw_only=True)
class Hall:
    """What else moves the readings, one standard deviation each (``aim_mrad``, ``tilt_mrad``: of
    each of two directions)."""

    noise_um: float = 0.3
    ramp_um: float = 0.5
    wander_um: float = 0.3
    index: float = 2e-7
    expansion_c: float = 0.3
    tilt_mrad: float = 0.35
    aim_mrad: float = 0.1


def drive(rng, plan: Plan, machine: RandomMachine, hall: Hall, u_um: float):
    """Return the readings of a survey driven on this machine in this hall."""
    readings = perfect_readings(plan, u_um)
    warm = machine.slopes + np.diag(11.7 * rng.normal(0, hall.expansion_c, 3))
    machine = RandomMachine(**{**vars(machine), "slopes": warm})
    stretched = 1 + rng.normal(0, hall.index)
    length = np.zeros(len(readings))
    aims = {}
    for key, rows in readings.passes().items():
        setup = setup_of(key.setup)
        if key.setup not in aims:
            aims[key.setup] = (
                rng.normal(0, 1e-3 * hall.tilt_mrad, 3),
                rng.normal(0, 1e-3 * hall.aim_mrad, 3),
            )
        length[rows] = stretched * _pass_mm(readings, rows, setup, machine, *aims[key.setup])
        count = len(rows)
        walk = np.concatenate(
            [[0.0], np.cumsum(rng.normal(0, hall.wander_um / np.sqrt(count - 1), count - 1))]
        )
        drift_um = walk + rng.normal(0, hall.ramp_um) * np.linspace(0, 1, count)
        length[rows] += 1e-3 * (drift_um + rng.normal(0, hall.noise_um, count))
        length[rows] -= length[rows[0]]
    object.__setattr__(readings, "reading_mm", length)
    return readings


def _pass_mm(readings, rows, setup, machine, tilt, aim):
    points, start = readings.position_mm[rows], readings.beam_mm[rows[0]]
    travel = np.array(setup.signs) * machine.size_mm
    along = travel / np.linalg.norm(travel)
    error, turned = machine.pose(points)
    if setup.kind == "linear":
        beam = along + aim - (aim @ along) * along
        return (points + error - start) @ beam / np.linalg.norm(beam)
    normal = along + tilt - (tilt @ along) * along
    beam = normal + aim - (aim @ along) * along
    beam /= np.linalg.norm(beam)
    normals = normal + np.cross(turned, normal)
    source = start - 500.0 * beam
    return np.sum(normals * (points + error - source), axis=1) / (normals @ beam)
