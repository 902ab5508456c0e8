"""The curves and products that fit the error field over the volume best, in the sense of least
squares.

A table of an axis is a single curve for the whole volume. An angular error moves the tool by a
lever, so the movement on the line of the measurement differs from the movement on the opposite
edge. The field of rigid bodies (theory 2.2) is a sum of curves and of terms ``alpha(a) (b - b_0)``,
an angle of axis a times a lever along axis b. With bars for the mean over the volume,

    alpha(a) (b - b_0) = alpha(a) (b_bar - b_0)  +  alpha_bar (b - b_bar)  +  (alpha(a) - alpha_bar)
    (b - b_bar)

The first two summands of this equation are curves. The third summand is orthogonal to every curve.
So the best fit of the whole field is the sum of the curves and of the first two summands. Only a
control with products of two tables, or with a lattice, can correct the third summand.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.errors import UsageError
from stepdiag.base.kinematics import abbe_mask, cross_matrix
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Vector, Volume
from stepdiag.exporters.tables.curves import (
    FOLD_DEFAULT,
    FUNCTIONS,
    SQUARENESS_SLOPE,
    Curve,
    curves_of,
)
from stepdiag.exporters.tables.tables import Table

_LETTERS = "XYZ"
_TURNS = "ABC"
_FINE = 401
"""Number of points over which a mean along an axis is taken."""
_BENT = 4
"""Number of straight sections between two nodes for the product of an angle and the travel of its
own axis, because this product is not straight between two nodes.
"""
_NOTHING_UM = 1e-3
"""Largest movement of a product that is ignored, in um."""

Zone = Mapping[str, tuple[float, float]]
"""The zone of the best fit: lowest and highest position in mm by axis letter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """The part of the error that only a product of two tables can correct.

    The error of the output axis is ``value_um * (b - middle_mm) / half_mm``, with the position b
    along ``by_axis``: ``value_um`` is the error at the end of the fitted zone. ``rms_um`` is the
    root mean square of this error over the zone, which remains without the product. ``u_um`` is the
    standard uncertainty of ``value_um``.
    """

    output_axis: str
    input_axis: str
    by_axis: str
    position_mm: Vector
    value_um: Vector
    u_um: Vector
    middle_mm: float
    half_mm: float
    rms_um: float

    @property
    def name(self) -> str:
        """Return the function and the lever, such as ``EYX*Z``: the error of Y along X that grows
        with Z.
        """
        return f"E{self.output_axis}{self.input_axis}*{self.by_axis}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """The curves to write, and the products; the product with the largest effect comes first."""

    curves: tuple[Curve, ...]
    products: tuple[Product, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Term:
    """One term ``alpha(a) (b - b_0)``: ``per_mm_um`` along the input axis is the error in um for
    one mm of lever.
    """

    output: int
    input: int
    by: int
    position_mm: Vector
    per_mm_um: Vector
    u_per_mm_um: Vector
    zero_mm: float
    source: str


def fitted(
    result: Result,
    names: Sequence[str] = FUNCTIONS,
    fold: Mapping[str, str] = FOLD_DEFAULT,
    zone: Zone | None = None,
    active: Sequence[Table] = (),
) -> Fitted:
    """Return the curves with the names ``names``, and the products, that best fit the field of the
    result over ``zone`` (without a zone, over the volume).

    ``active`` contains product tables that were active during the measurement. The field without
    these tables is fitted. Raises the ``DataError`` and ``UsageError`` of `curves_of`, and
    ``UsageError`` for a zone outside the measured volume.
    """
    ends = _ends(result.volume, zone or {})
    terms = [*_angular(result), *(_of_table(table) for table in active)]
    curves = {curve.name: curve for curve in curves_of(result, names, fold)}
    added = _folded(
        {
            f"E{output}{moving}": _added(terms, output, moving, ends, result)
            for output, moving in _pairs()
        },
        fold,
    )
    return Fitted(
        curves=tuple(
            _with(curves[name], added[name], _sources(terms, name)) for name in names
        ),
        products=tuple(sorted(_products(terms, ends), key=lambda product: -product.rms_um)),
    )


def straight_line_um_mm(curve: Curve) -> float:
    return line_um_mm(curve.position_mm, curve.mean_um)


def line_um_mm(position_mm: Vector, value_um: Vector) -> float:
    """Return the slope in um/mm of the straight line that fits some values best, with equal weight
    for equal lengths.
    """
    at = np.linspace(position_mm[0], position_mm[-1], _FINE)
    from_middle = at - np.mean(at)
    value = np.interp(at, position_mm, value_um)
    return float(np.sum(from_middle * value) / np.sum(from_middle**2))


def _pairs() -> Iterator[tuple[str, str]]:
    return ((output, moving) for output in _LETTERS for moving in _LETTERS)


def _ends(volume: Volume, zone: Zone) -> list[tuple[float, float]]:
    ends = []
    for index, letter in enumerate(_LETTERS):
        low, high = volume.origin_mm[index], volume.origin_mm[index] + volume.size_mm[index]
        first, last = zone.get(letter, (low, high))
        # An axis that did not travel has neither a zone nor a table.
        if volume.travelled[index] and not low <= first < last <= high:
            raise UsageError(
                f"axes.{letter}.working_mm",
                expected=message("rising-within", low=low, high_mm=high),
                found=f"{first:g}, {last:g}",
            )
        ends.append((first, last))
    return ends


def _angular(result: Result) -> Iterator[_Term]:
    """Yield the terms of every angular function in the result; 1 urad over 1 mm is 0.001 um."""
    mask, levers = (
        abbe_mask(result.chain),
        cross_matrix(np.eye(3)),
    )  # levers[b] @ turn = e_b x turn
    for moving, letter in enumerate(_LETTERS):
        for turn, word in enumerate(_TURNS):
            function = result.errors.get(f"E{word}{letter}")
            if function is None or function.value is None:
                continue
            for by in np.flatnonzero(mask[moving]):
                for output in range(3):
                    sign = -levers[by][output, turn]
                    if sign:
                        u = (
                            np.zeros(len(function.value))
                            if function.u is None
                            else function.u
                        )
                        yield _Term(
                            output=output,
                            input=moving,
                            by=int(by),
                            position_mm=function.position_mm,
                            per_mm_um=sign * function.value * 1e-3,
                            u_per_mm_um=u * 1e-3,
                            zero_mm=result.volume.origin_mm[by],
                            source=f"E{word}{letter}",
                        )


def _of_table(table: Table) -> _Term:
    """Return the term of the error that an active product table has corrected during the
    measurement.
    """
    if table.multiplier is None or not table.multiplier.is_straight:
        raise UsageError(
            table.label,
            expected=message("straight-product"),
            found=message("other-multiplier"),
            remedy=message("measure-off"),
        )
    slope, zero_mm = table.multiplier.line
    per_mm = -table.law.factor * table.absolute_um * slope
    return _Term(
        output=_LETTERS.index(table.output_axis),
        input=_LETTERS.index(table.input_axis),
        by=_LETTERS.index(table.multiplier.axis),
        position_mm=table.position_mm,
        per_mm_um=per_mm,
        u_per_mm_um=np.zeros(len(per_mm)),
        zero_mm=zero_mm,
        source="active table",
    )


def _mean(term: _Term, ends: Sequence[tuple[float, float]]) -> float:
    fine = np.linspace(*ends[term.input], _FINE)
    return float(
        np.trapezoid(np.interp(fine, term.position_mm, term.per_mm_um), fine)
        / (fine[-1] - fine[0])
    )


@dataclass(frozen=True, slots=True)
class _Added:
    position_mm: Vector
    value_um: Vector
    u_um: Vector

    def sloped(self, um_per_mm: float) -> "_Added":
        return replace(
            self,
            value_um=self.value_um + um_per_mm * (self.position_mm - self.position_mm[0]),
        )

    @property
    def slope(self) -> float:
        """Return the slope of the values' end-point line in um per mm, 0 for an axis that did not
        travel.
        """
        length_mm = float(self.position_mm[-1] - self.position_mm[0])
        return float(self.value_um[-1] - self.value_um[0]) / length_mm if length_mm else 0.0


def _added(
    terms: Sequence[_Term],
    output: str,
    moving: str,
    ends: Sequence[tuple[float, float]],
    result: Result,
) -> _Added:
    index = _LETTERS.index(moving)
    at = np.unique(
        np.concatenate(
            [
                result.volume.nodes_mm(index),
                *(t.position_mm for t in terms if t.input == index),
            ]
        )
    )
    if any(term.by == term.input == index for term in terms):  # bent between the nodes
        at = np.interp(np.arange(len(at) * _BENT - _BENT + 1) / _BENT, np.arange(len(at)), at)
    value, variance = np.zeros(at.shape), np.zeros(at.shape)
    for term in terms:
        if term.output != _LETTERS.index(output):
            continue
        lever = np.mean(ends[term.by]) - term.zero_mm
        if (
            term.by == term.input == index
        ):  # a work-side axis turns about its own origin: a function of that axis alone
            value += np.interp(at, term.position_mm, term.per_mm_um) * (at - term.zero_mm)
            variance += (
                np.interp(at, term.position_mm, term.u_per_mm_um) * (at - term.zero_mm)
            ) ** 2
        elif term.input == index:
            value += np.interp(at, term.position_mm, term.per_mm_um) * lever
            variance += (np.interp(at, term.position_mm, term.u_per_mm_um) * lever) ** 2
        elif term.by == index:
            value += _mean(term, ends) * (at - at[0])
            variance += (np.mean(term.u_per_mm_um) * (at - at[0])) ** 2
    return _Added(at, value - value[0], np.sqrt(variance))


def _folded(added: Mapping[str, _Added], fold: Mapping[str, str]) -> dict[str, _Added]:
    """Return the added values, with the slopes of both curves of a pair moved into the curve that
    ``fold`` names: this only rotates the workpiece.
    """
    result = dict(added)
    for squareness, target in fold.items():
        (other,) = [
            name for name in SQUARENESS_SLOPE.get(squareness, {}) if name != target
        ] or [target]
        if other != target:
            slope = result[other].slope
            result[other] = result[other].sloped(-slope)
            result[target] = result[target].sloped(slope)
    return result


def _with(curve: Curve, added: _Added, sources: tuple[str, ...]) -> Curve:
    if not sources:
        return curve
    at = np.unique(np.concatenate([curve.position_mm, added.position_mm]))
    more = np.interp(at, added.position_mm, added.value_um)
    return replace(
        curve,
        position_mm=at,
        forward_um=curve.at(at, +1) + more,
        reverse_um=None if curve.reverse_um is None else curve.at(at, -1) + more,
        u_um=np.hypot(
            np.interp(at, curve.position_mm, curve.u_um),
            np.interp(at, added.position_mm, added.u_um),
        ),
        parts=(*curve.parts, *sources),
    )


def _sources(terms: Sequence[_Term], name: str) -> tuple[str, ...]:
    output, moving = (_LETTERS.index(letter) for letter in name[1:])
    mine = [
        t.source
        for t in terms
        if (t.output == output and moving in (t.input, t.by))
        or (t.output == moving and output in (t.input, t.by))
    ]
    return tuple(dict.fromkeys(mine))


def _products(
    terms: Sequence[_Term], ends: Sequence[tuple[float, float]]
) -> Iterator[Product]:
    """Yield the third summands of the terms as products; terms with the same three axes form one
    product.
    """
    keys = dict.fromkeys(
        (term.output, term.input, term.by) for term in terms if term.by != term.input
    )
    for output, moving, by in keys:
        alike = [
            term
            for term in terms
            if (term.output, term.input, term.by) == (output, moving, by)
        ]
        at = np.unique(np.concatenate([term.position_mm for term in alike]))
        half = (ends[by][1] - ends[by][0]) / 2
        value = half * sum(
            (
                np.interp(at, term.position_mm, term.per_mm_um) - _mean(term, ends)
                for term in alike
            ),
            np.zeros(at.shape),
        )
        fine = np.linspace(*ends[moving], _FINE)
        rms = float(
            np.sqrt(np.mean(np.interp(fine, at, value) ** 2) / 3)
        )  # the mean square of a lever from -1 to 1 is a third
        if rms > _NOTHING_UM:
            u = half * np.sqrt(
                sum(
                    (
                        np.interp(at, term.position_mm, term.u_per_mm_um) ** 2
                        for term in alike
                    ),
                    np.zeros(at.shape),
                )
            )
            yield Product(
                output_axis=_LETTERS[output],
                input_axis=_LETTERS[moving],
                by_axis=_LETTERS[by],
                position_mm=at,
                value_um=value,
                u_um=u,
                middle_mm=float(np.mean(ends[by])),
                half_mm=half,
                rms_um=rms,
            )
