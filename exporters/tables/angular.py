"""Angles as separate columns, for controls that use the kinematic chain to compute the effect of an
axis' angles on the parts that the axis carries.

Such a control moves the tool by ``alpha(a) x r``, with levers ``r`` from the zero of its axes. The
fit (`fit`) describes the same field by curves, and by products with levers from the middle of the
volume. A product is converted into the column of an angle that is zero at the reference by

    g(a) (b - middle) = [g(a) - g(ref)] b  +  g(ref) b  -  g(a) middle

The first summand is the column of the angle, the second a curve along b, the third a curve along a.
If the control also uses the travel of the axis itself as a lever of its angles, the effect of this
lever is subtracted from the curve.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.kinematics import abbe_mask, parse_chain
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve
from stepdiag.exporters.tables.fit import Product
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.sampling import quantised
from stepdiag.exporters.tables.tables import Law, Multiplier, Table

COLUMN = "column"
LEVER_MM = 100.0
"""Lever in mm for which the product table of an angle contains the movement."""
_LETTERS, _TURNS = "XYZ", "ABC"


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle:
    """An angular function for a control: ``name``, such as EAX, on the grid of its axis, zero at
    the reference.
    """

    name: str
    position_mm: Vector
    value_urad: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """The curves and angles of a machine, which together move the tool as the fit does."""

    curves: tuple[Curve, ...]
    angles: tuple[Angle, ...]


def levers_of(chain: str, *, own: bool) -> Vector:
    """Return a matrix (axis, lever) with 1 for each axis whose travel is a lever of the angles of
    an axis, else 0. With ``own``, the travel of an axis on the workpiece side is also a lever of
    its own angles.
    """
    mask = abbe_mask(chain)
    return mask if own else mask * (1.0 - np.eye(3))


def require_chain(result: Result, profile: Profile) -> None:
    """Raise ``UsageError`` if profile and result state different chains: the angles would rotate
    the wrong axes.
    """
    stated = getattr(profile.options, "chain", None)
    if stated is not None and parse_chain(stated) != parse_chain(result.chain):
        raise UsageError(
            f"{profile.source}: {profile.machine.controller}.chain",
            expected=message("chain-quoted", chain=result.chain),
            found=f'"{stated}"',
        )


def columns_of(
    curves: Sequence[Curve], products: Sequence[Product], levers: Vector, profile: Profile
) -> Columns:
    """Return curves and angles for a control that uses the ``levers`` of `levers_of`.

    Without curves (a sign test), only the angles are returned. Raises ``UsageError`` if a function
    that the angles need is missing, or if the control does not use the lever of a product.
    """
    missing = [
        name for name in FUNCTIONS if curves and name not in {curve.name for curve in curves}
    ]
    if missing:
        raise UsageError(
            f"{profile.source}: machine.functions",
            expected=message("all-nine"),
            found=message("nothing-of", names=missing),
            remedy=message("leave-chain", control=profile.machine.controller),
        )
    middles = {product.by_axis: product.middle_mm for product in products}
    angles: list[Angle] = []
    moved = {curve.name: curve for curve in curves}
    for moving, letter in enumerate(_LETTERS):
        grid = profile.grid_mm(letter)
        reference = profile.axis(letter).reference_mm
        for turn in range(3):
            relative = _relative_urad(products, moving, turn, levers, profile, grid)
            if relative is None:
                continue
            at_reference = float(np.interp(reference, grid, relative))
            angle = Angle(
                name=f"E{_TURNS[turn]}{letter}",
                position_mm=grid,
                value_urad=relative - at_reference,
            )
            angles.append(angle)
            for by in np.flatnonzero(levers[moving]) if curves else ():
                _move(moved, angle, relative, at_reference, int(by), middles)
    return Columns(curves=tuple(moved[curve.name] for curve in curves), angles=tuple(angles))


def _relative_urad(
    products: Sequence[Product],
    moving: int,
    turn: int,
    levers: Vector,
    profile: Profile,
    grid: Vector,
) -> Vector | None:
    for product in products:
        output, by = _LETTERS.index(product.output_axis), _LETTERS.index(product.by_axis)
        sign = _sign(turn, by, output)
        if product.input_axis == _LETTERS[moving] and sign:
            if not levers[moving, by]:
                raise UsageError(
                    f"{profile.source}: {profile.machine.controller}.chain",
                    expected=message(
                        "chain-carried", by=product.by_axis, axis=product.input_axis
                    ),
                    found=product.name,
                )
            return (
                np.interp(grid, product.position_mm, product.value_um)
                * sign
                * 1e3
                / product.half_mm
            )
    return None


def _move(
    curves: dict[str, Curve],
    angle: Angle,
    relative_urad: Vector,
    at_reference_urad: float,
    by: int,
    middles: Mapping[str, float],
) -> None:
    """Correct the curves for an angle and its lever along ``by``: the control adds a movement that
    the fit does not contain, and this movement is subtracted.
    """
    turn, moving = _TURNS.index(angle.name[1]), _LETTERS.index(angle.name[2])
    for output in range(3):
        sign = _sign(turn, by, output) * 1e-3
        if not sign:
            continue
        along = f"E{_LETTERS[output]}{_LETTERS[moving]}"
        if by == moving:
            curves[along] = _plus(
                curves[along], angle.position_mm, -sign * angle.value_urad * angle.position_mm
            )
            continue
        curves[along] = _plus(
            curves[along],
            angle.position_mm,
            -sign * relative_urad * middles.get(_LETTERS[by], 0.0),
        )
        across = curves[f"E{_LETTERS[output]}{_LETTERS[by]}"]
        ends = across.position_mm[[0, -1]]
        curves[across.name] = _plus(across, ends, sign * at_reference_urad * ends)


def _plus(curve: Curve, position_mm: Vector, value_um: Vector) -> Curve:
    at = np.unique(np.concatenate([curve.position_mm, position_mm]))
    more = np.interp(at, position_mm, value_um)
    return replace(
        curve,
        position_mm=at,
        forward_um=curve.at(at, +1) + more,
        reverse_um=None if curve.reverse_um is None else curve.at(at, -1) + more,
        u_um=np.interp(at, curve.position_mm, curve.u_um),
    )


def _sign(turn: int, by: int, output: int) -> float:
    """Return the movement of an axis by a unit rotation and a unit lever: a component of the vector
    product turn x lever.
    """
    return float(np.cross(np.eye(3)[turn], np.eye(3)[by])[output])


def angle_tables(
    angle: Angle,
    levers: Vector,
    profile: Profile,
    *,
    kind: str,
    laws: Mapping[str, Law],
    quantum_urad: float,
    place: Mapping[str, int | str],
) -> Iterator[Table]:
    """Yield the effect of an angle's column in the control: a product table for each moved axis and
    each lever. ``laws`` contains the laws of the values by output axis.
    """
    turn, moving = _TURNS.index(angle.name[1]), _LETTERS.index(angle.name[2])
    for by in np.flatnonzero(levers[moving]):
        letter = _LETTERS[by]
        ends = profile.grid_mm(letter)[[0, -1]]
        for output in range(3):
            sign = _sign(turn, int(by), output)
            if not sign:
                continue
            law = laws[_LETTERS[output]]
            per_urad = sign * LEVER_MM * 1e-3
            yield Table(
                kind=kind,
                input_axis=angle.name[2],
                output_axis=_LETTERS[output],
                position_mm=angle.position_mm,
                value_um=quantised(angle.value_urad, quantum_urad) * per_urad * -law.factor,
                quantum_um=quantum_urad * abs(per_urad),
                law=law,
                reference_mm=profile.axis(angle.name[2]).reference_mm,
                place={**place, COLUMN: angle.name},
                multiplier=Multiplier(
                    axis=letter, position_mm=ends, value=ends / LEVER_MM, ends="extended"
                ),
            )


def column_urad(table: Table) -> Vector:
    by = "" if table.multiplier is None else table.multiplier.axis
    sign = _sign(
        _TURNS.index(str(table.place[COLUMN])[1]),
        _LETTERS.index(by),
        _LETTERS.index(table.output_axis),
    )
    return np.asarray(table.value_um * sign * 1e3 / LEVER_MM)
