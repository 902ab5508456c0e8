"""The error of the tool at any point of the volume, computed from the error functions of a result
(theory of the rigid-body model, section 2.2)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.kinematics import abbe_mask, cross_matrix
from stepdiag.base.messages import message
from stepdiag.base.names import AXES, BODY_DIAGONALS, PRODUCTS
from stepdiag.base.result.result import DISPLACEMENTS, SQUARENESS, Result
from stepdiag.base.volume import Vector, Volume, diagonal_direction, travel_signs

BEYOND_MM = 1.0
"""Largest distance in mm of a target outside the measured volume. Beyond the volume, functions have
their end values."""


class Tabulated(NamedTuple):
    """Error functions of the position of one axis: linear between the positions, constant beyond
    them. ``value`` has the shape (machines, k)."""

    position_mm: Vector
    value: Vector

    def at(self, points_mm: Vector) -> Vector:
        """Return the values of the functions at positions, shape (machines, N)."""
        if len(self.value) > len(self.position_mm):
            return _of_many(self, points_mm)
        place = np.clip(
            np.searchsorted(self.position_mm, points_mm, side="right") - 1,
            0,
            len(self.position_mm) - 2,
        )
        low, high = self.position_mm[place], self.position_mm[place + 1]
        share = np.clip((points_mm - low) / (high - low), 0.0, 1.0)
        values: Vector = (
            self.value[:, place] * (1.0 - share) + self.value[:, place + 1] * share
        )
        return values


class Smoothed(NamedTuple):
    """Error functions as cubic splines through evenly spaced values, with a parabola in the first
    and the last cell.

    The spline differs from waves of 3.3 increments by 7 % of their size; a parabola through each
    value and its neighbours differs by 22 %.
    """

    position_mm: Vector
    value: Vector

    def at(self, points_mm: Vector) -> Vector:
        """Return the values of the functions at positions, shape (machines, N)."""
        if len(self.value) > len(self.position_mm):
            return _of_many(self, points_mm)
        straight = Tabulated(self.position_mm, self.value).at(points_mm)
        place = np.clip(
            np.searchsorted(self.position_mm, points_mm, side="right") - 1,
            0,
            len(self.position_mm) - 2,
        )
        length = self.position_mm[place + 1] - self.position_mm[place]
        share = np.clip((points_mm - self.position_mm[place]) / length, 0.0, 1.0)
        curved = self._curved()
        both = (2.0 - share) * curved[:, place] + (1.0 + share) * curved[:, place + 1]
        bent: Vector = straight - length**2 / 6.0 * share * (1.0 - share) * both
        return bent

    def _curved(self) -> Vector:
        even_mm = evenly(self.position_mm)
        value = Tabulated(self.position_mm, self.value).at(even_mm)
        inner = np.diff(value, n=2, axis=1) / (even_mm[1] - even_mm[0]) ** 2
        if inner.shape[1] < 2:
            return np.broadcast_to(np.sum(inner, axis=1, keepdims=True), self.value.shape)
        size = len(even_mm)
        system = 4.0 * np.eye(size) + np.eye(size, k=1) + np.eye(size, k=-1)
        # a parabola in the first and the last cell: a third derivative there would be noise
        system[0, 1] = system[-1, -2] = -4.0
        target = np.pad(6.0 * inner, ((0, 0), (1, 1)))
        return Tabulated(even_mm, np.linalg.solve(system, target.T).T).at(self.position_mm)


def _of_many(functions: Tabulated | Smoothed, points_mm: Vector) -> Vector:
    """Return the values of `at` for more machines than positions: the effect of a unit value at
    each position, times the values."""
    values: Vector = functions.value @ functions._replace(
        value=np.eye(len(functions.position_mm))
    ).at(points_mm)
    return values


def evenly(position_mm: Vector) -> Vector:
    """Return equally spaced positions over the range of given positions, with a spacing of at most
    their largest spacing."""
    low, high = position_mm[0], position_mm[-1]
    even: Vector = np.linspace(
        low, high, round(float((high - low) / np.max(np.diff(position_mm)))) + 1
    )
    return even


def field_of_um(
    volume: Volume,
    chain: str,
    functions: Mapping[str, Tabulated | Smoothed],
    squareness: Mapping[str, Vector],
    points_mm: Vector,
) -> Vector:
    """Return the error of one or several machines at points (N, 3), shape (machines, N, 3) in um;
    ``squareness`` may contain `PRODUCTS`.

    ``E(P) = sum_a [delta_a(a) + alpha_a(a) x r_a]`` plus the squarenesses of contract 1: dX = -C0Y
    y, dX = +B0Z z, dY = -A0Z z. Abbe arms and squarenesses refer to the low corner of the volume,
    where every function is zero by definition.
    """
    points = np.atleast_2d(np.asarray(points_mm, dtype=np.float64))
    from_corner = points - np.asarray(volume.origin_mm)
    machines = max(
        [len(table.value) for table in functions.values()]
        + [len(value) for value in squareness.values()],
        default=1,
    )
    parts = np.zeros((3, machines, len(points)))
    for name in squareness.keys() & PRODUCTS.keys():
        component, axes = PRODUCTS[name]
        share = np.prod(
            from_corner[:, axes] / np.asarray(volume.length_mm)[list(axes)], axis=1
        )
        parts[component] += np.asarray(squareness[name])[:, None] * share
    if squareness.keys() & set(SQUARENESS):
        c0y, b0z, a0z = (
            1e-3 * np.asarray(squareness.get(name, np.zeros(1)))[:, None]
            for name in SQUARENESS
        )
        _, y, z = from_corner.T
        parts[0] += -c0y * y + b0z * z
        parts[1] += -a0z * z
    mask = abbe_mask(chain)
    for axis, letter in enumerate(letter.upper() for letter in AXES):
        arm = 1e-3 * mask[axis] * from_corner
        for component, (along, about) in enumerate(zip("XYZ", "ABC", strict=True)):
            if f"E{along}{letter}" in functions:
                parts[component] += functions[f"E{along}{letter}"].at(points[:, axis])
            if f"E{about}{letter}" in functions:
                turn = functions[f"E{about}{letter}"].at(points[:, axis])
                lever = np.cross(np.eye(3)[component], arm)
                for along_component in np.flatnonzero(np.any(lever, axis=0)):
                    parts[along_component] += turn * lever[:, along_component]
    field: Vector = np.stack([*parts], axis=2)
    return field


def error_field_um(result: Result, points_mm: Vector) -> Vector:
    """Return actual - commanded at points of the machine, shape (N, 3) in um; an unidentified error
    counts as zero.

    Angular functions without a measurement have their expected values (``result.expected``), with
    which the displacement functions were estimated.
    """
    known = {**result.errors, **result.expected}
    functions = {
        name: Tabulated(function.position_mm, function.value[None, :])
        for name, function in known.items()
        if function.value is not None
    }
    squareness = {
        name: np.array([quantity.value or 0.0])
        for name, quantity in result.squareness.items()
    }
    field: Vector = field_of_um(
        result.volume, result.chain, functions, squareness, points_mm
    )[0]
    return field


def bend_um(result: Result, points_mm: Vector) -> Vector:
    """Return the difference between smooth displacement functions and the straight lines between
    their values, at points, shape (N, 3).

    A table that is linear between the values does not correct this difference.
    """
    known = {name: result.errors[name] for name in DISPLACEMENTS if name in result.errors}
    parts = []
    for kind in (Smoothed, Tabulated):
        tables = {
            name: kind(one.position_mm, one.value[None, :])
            for name, one in known.items()
            if one.value is not None
        }
        parts.append(field_of_um(result.volume, result.chain, tables, {}, points_mm)[0])
    bent: Vector = parts[0] - parts[1]
    return bent


def without_rigid_motion(volume: Volume, points_mm: Vector, errors_um: Vector) -> Vector:
    """Return the errors less the translation and rotation of the whole volume that fit them best,
    shape (N, 3).

    A rigid motion depends on the place of the workpiece and is no error of the machine.
    """
    motion = rigid_motions(volume, points_mm)
    flat = errors_um.reshape(-1)
    rest: Vector = (flat - motion @ (motion.T @ flat)).reshape(errors_um.shape)
    return rest


def rigid_motions(volume: Volume, points_mm: Vector) -> Vector:
    """Return an orthonormal basis of the rigid motions of points (N, 3), shape (3 N, 6)."""
    lever = (points_mm - np.asarray(volume.origin_mm) - np.asarray(volume.size_mm) / 2) * 1e-3
    turns = -cross_matrix(lever)
    shifts = np.broadcast_to(np.eye(3), turns.shape)
    design = np.concatenate([shifts, turns], axis=2).reshape(-1, 6)
    left, size, _ = np.linalg.svd(design, full_matrices=False)
    basis: Vector = left[:, size > 1e-9 * size[0]]
    return basis


def along_diagonal_um(result: Result, diagonal: str, distance_mm: Vector) -> Vector:
    """Return the error along a straight body diagonal (ISO 230-6) at distances (N,) from its first
    corner, in um, less the error at the first distance, shape (N,).

    The solver does not use straight diagonals, so they are an independent check. Raises UsageError
    for an invalid diagonal, or distances outside the measured volume.
    """
    if diagonal not in BODY_DIAGONALS:
        raise UsageError(
            "diagonal", expected=message("one-of", names=BODY_DIAGONALS), found=repr(diagonal)
        )
    size, origin = np.asarray(result.volume.size_mm), np.asarray(result.volume.origin_mm)
    length = float(np.linalg.norm(size))
    if distance_mm.min() < -BEYOND_MM or distance_mm.max() > length + BEYOND_MM:
        found = message("mm-to", low=distance_mm.min(), high_mm=distance_mm.max())
        remedy = message("targets-straight-body-diagonal")
        raise UsageError(
            diagonal,
            expected=message("targets-from-0-mm", length=length),
            found=found,
            remedy=remedy,
        )
    along = diagonal_direction(result.volume, diagonal)
    corner = np.where(travel_signs(diagonal) > 0, origin, origin + size)
    points = corner + distance_mm[:, None] * along
    predicted: Vector = error_field_um(result, points) @ along
    relative: Vector = predicted - predicted[0]
    return relative


def from_first(values: Vector, nodes: Vector, *, shape: bool) -> Vector:
    """Return a function relative to its value at the first node; with ``shape``, its end-point line
    is removed."""
    line = (values[-1] - values[0]) * (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    rest: Vector = values - values[0] - (line if shape else 0.0)
    return rest
