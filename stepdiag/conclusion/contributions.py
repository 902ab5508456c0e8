"""Contribution of each error of the machine to the volumetric error in um, the largest first."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.base.kinematics import abbe_mask
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Function, Result
from stepdiag.base.volume import Vector, Volume

Kind = Literal["squareness", "scale", "positioning", "straightness", "angle", "reversal"]
LEANS = {"C0Y": ("Y", "X"), "B0Z": ("Z", "X"), "A0Z": ("Z", "Y")}
"""The axis that leans, and the axis towards which it leans, by squareness error (ISO 230-1)."""
AXES = "XYZ"


@dataclass(frozen=True, slots=True, kw_only=True)
class Contribution:
    """An error of the machine. ``effect_um`` is the movement of the tool that this error causes
    from one end of the volume to the other, ``u_um`` its standard uncertainty.

    ``value`` is the error in ``unit``; for a function, ``value`` is the range of the function.
    ``length_mm`` is the travel over which the effect is computed.
    """

    name: str
    kind: Kind
    axis: str
    value: float
    unit: str
    effect_um: float
    u_um: float | None
    length_mm: float

    @property
    def significant(self) -> bool:
        """Return whether the effect of an error exceeds its expanded uncertainty (k = 2); an effect
        without uncertainty is significant."""
        return self.u_um is None or self.effect_um > 2 * self.u_um


def contributions_of(result: Result) -> tuple[Contribution, ...]:
    """Return the identified errors, the largest effect first; errors of equal effect are sorted by
    name."""
    found = [
        *_squareness(result),
        *_scales(result),
        *_functions(result),
        *_angles(result),
        *_reversals(result),
    ]
    return tuple(sorted(found, key=lambda one: (-one.effect_um, one.name)))


def _squareness(result: Result) -> Iterator[Contribution]:
    for name, (axis, _) in LEANS.items():
        quantity, length = result.squareness[name], _length_mm(result.volume, axis)
        if quantity.value is not None:
            yield Contribution(
                name=name,
                kind="squareness",
                axis=axis,
                value=quantity.value,
                unit="urad",
                length_mm=length,
                effect_um=abs(quantity.value) * length * 1e-3,
                u_um=_times(quantity.u, length * 1e-3),
            )


def _scales(result: Result) -> Iterator[Contribution]:
    for axis, scale in result.scale.items():
        length = _length_mm(result.volume, axis)
        if scale.value is not None:
            yield Contribution(
                name=f"scale {axis}",
                kind="scale",
                axis=axis,
                value=scale.value,
                unit="um/m",
                length_mm=length,
                effect_um=abs(scale.value) * length * 1e-3,
                u_um=_times(scale.u, length * 1e-3),
            )


def _functions(result: Result) -> Iterator[Contribution]:
    """Yield the contributions of the functions without their end-point lines, which belong to the
    scale or the squareness."""
    for name in DISPLACEMENTS:
        function = result.errors[name]
        if function.value is None:
            continue
        value, u = _range(function, _without_line(function))
        kind: Kind = "positioning" if name[1] == name[2] else "straightness"
        yield Contribution(
            name=name,
            kind=kind,
            axis=name[2],
            value=value,
            unit="um",
            effect_um=value,
            u_um=u,
            length_mm=_length_mm(result.volume, name[2]),
        )


def _angles(result: Result) -> Iterator[Contribution]:
    mask = abbe_mask(result.chain)
    for name in ROTATIONS:
        function = result.errors.get(name)
        if function is None or function.value is None:
            continue
        about, axis = "ABC".index(name[1]), AXES.index(name[2])
        arm = np.asarray(mask[axis]) * np.asarray(result.volume.size_mm)
        lever_mm = float(np.linalg.norm(np.delete(arm, about)))
        value, u = _range(function, function.value)
        if lever_mm > 0:
            yield Contribution(
                name=name,
                kind="angle",
                axis=name[2],
                value=value,
                unit="urad",
                length_mm=lever_mm,
                effect_um=value * lever_mm * 1e-3,
                u_um=_times(u, lever_mm * 1e-3),
            )


def _reversals(result: Result) -> Iterator[Contribution]:
    for axis in AXES:
        function = result.reversal.get(f"E{axis}{axis}")
        if function is None or function.value is None:
            continue
        node = int(np.argmax(np.abs(function.value)))
        u = None if function.u is None else float(function.u[node])
        yield Contribution(
            name=f"reversal {axis}",
            kind="reversal",
            axis=axis,
            value=float(function.value[node]),
            unit="um",
            u_um=u,
            effect_um=abs(float(function.value[node])),
            length_mm=_length_mm(result.volume, axis),
        )


def _without_line(function: Function) -> Vector:
    assert function.value is not None
    at = (function.position_mm - function.position_mm[0]) / (
        function.position_mm[-1] - function.position_mm[0]
    )
    rest: Vector = (
        function.value - function.value[0] - (function.value[-1] - function.value[0]) * at
    )
    return rest


def _range(function: Function, value: Vector) -> tuple[float, float | None]:
    low, high = int(np.argmin(value)), int(np.argmax(value))
    u = None if function.u is None else float(np.hypot(function.u[low], function.u[high]))
    return float(value[high] - value[low]), u


def _length_mm(volume: Volume, axis: str) -> float:
    return float(volume.size_mm[AXES.index(axis)])


def _times(u: float | None, factor: float) -> float | None:
    return None if u is None else u * factor
