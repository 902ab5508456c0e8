"""The values of a result in SI units, each with its name, U and unit; all values of the
certificate come from here."""

from collections.abc import Iterator, Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np

from stepdiag.base.conformity import COVERAGE
from stepdiag.base.result.interval import FieldFigures, Interval
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Result

METRE, RADIAN, ONE, KELVIN, PASCAL = r"\metre", r"\radian", r"\one", r"\kelvin", r"\pascal"
UNITS = {
    "um": (METRE, -6),
    "urad": (RADIAN, -6),
    "um/m": (ONE, -6),
    "mm": (METRE, -3),
    "hpa": (PASCAL, 2),
    "percent": (ONE, -2),
}
"""Units of the result, each with its D-SI unit and the power of ten between them."""
ISO_230_2 = (
    "E_up",
    "E_down",
    "E",
    "M",
    "B",
    "B_mean",
    "R_up",
    "R_down",
    "R",
    "A_up",
    "A_down",
    "A",
    "E_d",
    "B_d",
    "R_d",
    "A_d",
)


COVARIANCE_DECIMALS = 6
"""Decimals of a covariance in um^2 or urad^2: 1e-6 is less than a thousandth of u^2 for U = 0.1."""


class Figure(NamedTuple):
    """A quantity of a certificate: ``name``, ``refers`` (refType), ``unit``, ``values`` as texts,
    their U (``expanded``, k = 2), their positions in metres (``at``), and their covariance (k = 1).
    The covariance is a sequence of columns; its unit is the square of ``unit``."""

    name: str
    refers: str
    unit: str
    values: tuple[str, ...]
    expanded: tuple[str, ...] = ()
    at: tuple[str, ...] = ()
    covariance: tuple[tuple[str, ...], ...] = ()


def written(value: float, power: int) -> str:
    """Return a number times a power of ten as the exact decimal text that the schema requires."""
    scaled = Decimal(repr(float(value))).scaleb(power).normalize()
    if not scaled:
        return "0"
    return (
        format(scaled, "E").replace("+", "")
        if abs(scaled.adjusted()) > 5
        else format(scaled, "f")
    )


def _figure(
    name: str,
    unit: str,
    values: Sequence[float],
    u: Sequence[float] | None = None,
    at: Sequence[float] = (),
) -> Figure:
    unit_si, power = UNITS[unit]
    return Figure(
        name,
        f"machineTool_{name.replace(' ', '_')}",
        unit_si,
        tuple(written(value, power) for value in values),
        () if u is None else tuple(written(COVERAGE * each, power) for each in u),
        tuple(written(each, -3) for each in at),
    )


def figures_of(result: Result) -> Iterator[Figure]:
    """Yield every identified value of a result: functions, reversals, squareness, scales, values
    of standards, volume.

    Each displacement function has a covariance over its travel; the three squarenesses have a
    common covariance.
    """
    together = [
        name
        for name, number in result.squareness.items()
        if number.value is not None and number.u is not None
    ]
    if (covariance := _covariance(result, together)) and len(together) > 1:
        known = [result.squareness[name] for name in together]
        numbers = [(one.value or 0.0, one.u or 0.0) for one in known]
        figure = _figure(
            " ".join(["squareness", *together]), "urad", *zip(*numbers, strict=True)
        )
        yield figure._replace(covariance=covariance)
    for part, of in (("", result.errors), ("reversal ", result.reversal)):
        for name in (*DISPLACEMENTS, *ROTATIONS):
            function = of.get(name)
            if function is not None and function.value is not None:
                u = None if function.u is None else function.u.tolist()
                covariance = (
                    _covariance(result, [name]) if name in DISPLACEMENTS and not part else ()
                )
                one = _figure(
                    part + name,
                    function.unit,
                    function.value.tolist(),
                    u,
                    function.position_mm.tolist(),
                )
                yield one._replace(covariance=covariance)
    for name, number in result.squareness.items():
        if number.value is not None:
            yield _figure(
                name, "urad", [number.value], None if number.u is None else [number.u]
            )
    for axis, scale in result.scale.items():
        if scale.value is not None:
            yield _figure(
                f"scale {axis}", "um/m", [scale.value], None if scale.u is None else [scale.u]
            )
    yield from _standards(result)
    if result.predicted is not None:
        yield from _volume("", result.predicted.without_rigid_motion["before"])


def _covariance(result: Result, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the covariance of quantities: the correlations of the posterior, scaled with the
    standard uncertainties of the result. Return an empty covariance if the posterior has other
    positions than the values, or if a standard uncertainty is missing."""
    deviations = {} if result.posterior is None else result.posterior.deviations()
    if not names or not set(names) <= deviations.keys():
        return ()
    columns = np.column_stack([deviations[name][1:] for name in names])
    stated = [
        result.squareness[name].u if name in result.squareness else result.errors[name].u
        for name in names
    ]
    u = np.concatenate(
        [
            np.atleast_1d(np.asarray(np.nan if each is None else each, dtype=float))
            for each in stated
        ]
    )
    if len(u) != columns.shape[1] or not np.isfinite(u).all():
        return ()
    product = columns.T @ columns
    deviation = np.sqrt(np.diag(product))
    scale = np.divide(u, deviation, out=np.zeros_like(u), where=deviation > 0)
    found = np.round(product * np.outer(scale, scale), COVARIANCE_DECIMALS)
    return tuple(tuple(written(float(each), -12) for each in column) for column in found.T)


def predicted_figures(result: Result) -> Iterator[Figure]:
    """Yield the volumetric values predicted after an ideal compensation."""
    if result.predicted is not None:
        yield from _volume("predicted ", result.predicted.without_rigid_motion["after"])


def _standards(result: Result) -> Iterator[Figure]:
    for run, found in (result.standards or {}).items():
        for figures in found[:1]:
            for symbol in ISO_230_2:
                value, expanded = getattr(figures, symbol), (figures.U or {}).get(symbol)
                if value is not None:
                    yield _figure(
                        f"{run} {symbol}",
                        "um",
                        [value],
                        None if expanded is None else [expanded / COVERAGE],
                    )


def _volume(when: str, figures: FieldFigures) -> Iterator[Figure]:
    """Yield the volumetric values with the ends of their intervals instead of U, because their
    distribution is skewed."""
    both: tuple[tuple[str, Interval], ...] = (
        ("volumetric rms", figures.rms_um),
        ("volumetric largest", figures.largest_um),
    )
    for name, interval in both:
        for end, value in (
            ("", interval.value_um),
            (" low", interval.low_um),
            (" high", interval.high_um),
        ):
            if value is not None:
                yield _figure(f"{when}{name}{end}", "um", [value])
