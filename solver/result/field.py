"""The error of the tool at any point of the volume, from the functions of a result (theory of the rigid-body model, section 2.2)."""

import numpy as np

from stepdiag.solver.geometry.kinematics import abbe_mask, cross_matrix
from stepdiag.solver.geometry.volume import AXES, Vector, Volume
from stepdiag.solver.result.result import Result


def error_field_um(result: Result, points_mm: Vector) -> Vector:
    """Return actual - commanded at points of the machine, shape (N, 3) in um; what is not identified counts as zero.

    ``E(P) = sum_a [delta_a(a) + alpha_a(a) x r_a]`` plus the squarenesses of contract 1: dX = -C0Y y, dX = +B0Z z, dY = -A0Z z. Arms and
    squarenesses count from the low corner of the volume, where every function is zero by definition.
    """
    points = np.atleast_2d(np.asarray(points_mm, dtype=np.float64))
    from_corner = points - np.asarray(result.volume.origin_mm)
    field = _squareness_um(result, from_corner)
    mask = abbe_mask(result.chain)
    for axis, letter in enumerate(letter.upper() for letter in AXES):
        at = points[:, axis]
        field += np.column_stack([_function(result, f"E{component}{letter}", at) for component in "XYZ"])
        rotation = np.column_stack([_function(result, f"E{component}{letter}", at) for component in "ABC"])
        field += np.cross(rotation, mask[axis] * from_corner) * 1e-3
    return field


def _function(result: Result, name: str, at_mm: Vector) -> Vector:
    known = result.errors.get(name)
    if known is None or known.value is None:
        return np.zeros(len(at_mm))
    values: Vector = np.interp(at_mm, known.position_mm, known.value)
    return values


def _squareness_um(result: Result, from_corner_mm: Vector) -> Vector:
    """Return the displacement by the three squarenesses; 1 urad over 1 mm is 0.001 um."""
    c0y, b0z, a0z = (result.squareness[name].value or 0.0 for name in ("C0Y", "B0Z", "A0Z"))
    _, y, z = from_corner_mm.T
    return np.column_stack([-c0y * y + b0z * z, -a0z * z, np.zeros(len(y))]) * 1e-3


def without_rigid_motion(volume: Volume, points_mm: Vector, errors_um: Vector) -> Vector:
    """Return the errors less the translation and rotation of the whole volume that fit them best, shape (N, 3).

    A rigid motion is a matter of where the workpiece lies, not an error of the machine.
    """
    lever = (points_mm - np.asarray(volume.origin_mm) - np.asarray(volume.size_mm) / 2) * 1e-3
    turns = -cross_matrix(lever)
    shifts = np.broadcast_to(np.eye(3), turns.shape)
    design = np.concatenate([shifts, turns], axis=2).reshape(-1, 6)
    motion = np.linalg.lstsq(design, errors_um.reshape(-1), rcond=None)[0]
    rest: Vector = errors_um - (design @ motion).reshape(errors_um.shape)
    return rest
