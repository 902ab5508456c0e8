"""Charts of the report: lines with their bands at k = 2, and bars."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conformity import COVERAGE
from stepdiag.report.drawings import svg

Vector = NDArray[np.float64]

WIDTH, HEIGHT = 460.0, 250.0
INTERVALS = 5
"""Smallest distance in px between the marks of an axis, before rounding."""
NEAR_PX = 6.0
"""Largest distance in px between the pointer and a node at which the value of the node appears."""
LEFT, RIGHT, TOP, BOTTOM = 56.0, 20.0, 14.0, 38.0
LETTER_PX = 9.2
"""Size of the legend's letters in print: with three drawings side by side, letters must be half as
large again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """A line of a chart: ``x``, ``y`` and the standard uncertainty ``u`` (k = 1), which is NaN or
    None if unknown."""

    label: str
    x: Vector
    y: Vector
    u: Vector | None = None


@dataclass(frozen=True, slots=True)
class Scale:
    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        return self.start + (value - self.low) / (self.high - self.low) * (
            self.end - self.start
        )


def ticks(low: float, high: float) -> list[float]:
    """Return round values (1, 2 or 5 times a power of ten apart) that cover ``low`` to ``high``."""
    span = high - low
    raw = span / INTERVALS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(
        factor * power
        for factor in (1.0, 2.0, 5.0, 10.0)
        if factor * power >= raw * (1 - 1e-9)
    )
    first = math.floor(low / step + 1e-9)
    last = math.ceil(high / step - 1e-9)
    return [index * step for index in range(first, last + 1)]


def _span(values: Sequence[Vector]) -> tuple[float, float]:
    finite = np.concatenate([v[np.isfinite(v)] for v in values]) if values else np.zeros(0)
    if finite.size == 0:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    if high - low < 1e-9 * max(1.0, abs(low), abs(high)):
        return low - 0.5, high + 0.5
    return low, high


def _label(value: float, step: float) -> str:
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    shown = f"{value:.{decimals}f}"
    return shown[1:] if shown.startswith("-") and float(shown) == 0 else shown


def _frame(horizontal: Scale, vertical: Scale, x_label: str, y_label: str) -> list[str]:
    parts: list[str] = []
    for scale, is_x in ((horizontal, True), (vertical, False)):
        marks = [
            t
            for t in ticks(scale.low, scale.high)
            if scale.low - 1e-9 <= t <= scale.high + 1e-9
        ]
        step = marks[1] - marks[0] if len(marks) > 1 else 1.0
        for mark in marks:
            at, name = scale(mark), _label(mark, step)
            if is_x:
                parts.append(
                    svg.element(
                        "path",
                        d=svg.path([(at, vertical.start), (at, vertical.end)]),
                        class_="grid",
                    )
                )
                parts.append(
                    svg.text(
                        name, at, vertical.start + 14, class_="tick", text_anchor="middle"
                    )
                )
            else:
                kind = "zero" if abs(mark) < step * 1e-6 else "grid"
                line = svg.path([(horizontal.start, at), (horizontal.end, at)])
                parts.append(svg.element("path", d=line, class_=kind))
                parts.append(
                    svg.text(
                        name, horizontal.start - 6, at + 3.5, class_="tick", text_anchor="end"
                    )
                )
    middle = (horizontal.start + horizontal.end) / 2
    parts.append(svg.text(x_label, middle, HEIGHT - 6, class_="axis", text_anchor="middle"))
    upright = f"rotate(-90 12 {svg.number((vertical.start + vertical.end) / 2)})"
    parts.append(
        svg.text(
            y_label,
            12,
            (vertical.start + vertical.end) / 2,
            class_="axis",
            text_anchor="middle",
            transform=upright,
        )
    )
    return parts


def _runs(mask: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _band(series: Series, horizontal: Scale, vertical: Scale, order: int) -> list[str]:
    if series.u is None:
        return []
    half = COVERAGE * series.u
    parts = []
    for run in _runs(np.isfinite(series.y) & np.isfinite(half)):
        x, y, h = series.x[run], series.y[run], half[run]
        upper = [(horizontal(a), vertical(b)) for a, b in zip(x, y + h, strict=True)]
        lower = [(horizontal(a), vertical(b)) for a, b in zip(x, y - h, strict=True)]
        shape = svg.path([*upper, *reversed(lower)], closed=True)
        parts.append(svg.element("path", d=shape, class_=f"band s{order}"))
    return parts


def _chart_line(series: Series, horizontal: Scale, vertical: Scale, order: int) -> list[str]:
    parts = []
    for run in _runs(np.isfinite(series.y)):
        points = [
            (horizontal(a), vertical(b))
            for a, b in zip(series.x[run], series.y[run], strict=True)
        ]
        parts.append(svg.element("path", d=svg.path(points), class_=f"line s{order}"))
        parts += [
            svg.element("circle", cx=x, cy=y, r=2.0, class_=f"dot s{order}")
            for x, y in points
        ]
    return parts


def _values(
    series: Series, horizontal: Scale, vertical: Scale, x_label: str, y_label: str
) -> list[str]:
    (x_name, x_unit), (y_name, y_unit) = (
        label.partition(" / ")[::2] for label in (x_label, y_label)
    )
    parts = []
    for index in np.flatnonzero(np.isfinite(series.y)).tolist():
        x, y = float(series.x[index]), float(series.y[index])
        u = float("nan") if series.u is None else float(series.u[index])
        expanded = f" ± {svg.fixed(COVERAGE * u)}" if math.isfinite(u) else ""
        label = (
            f"{series.label}: {x_name} = {x:.5g} {x_unit}, {y_name} = {svg.fixed(y)}{expanded} "
            f"{y_unit}"
        )
        parts.append(
            svg.titled(
                " ".join(label.split()), "circle", cx=horizontal(x), cy=vertical(y), r=NEAR_PX
            )
        )
    return parts


def _legend(series: Sequence[Series]) -> list[str]:
    parts, at = [], LEFT + 4
    room = WIDTH - at - 30 * len(series)
    letter = min(LETTER_PX, room / max(sum(len(one.label) for one in series), 1))
    for order, one in enumerate(series):
        parts.append(
            svg.element("path", d=svg.path([(at, 9), (at + 16, 9)]), class_=f"line s{order}")
        )
        parts.append(svg.text(one.label, at + 20, 12, class_="tick"))
        at += 30 + letter * len(one.label)
    return parts


def line_chart(series: Sequence[Series], *, label: str, x_label: str, y_label: str) -> str:
    """Return a drawing of lines with dots at the nodes and their bands at k = 2; NaN values are
    left out."""
    reaches = [
        s.y + sign * COVERAGE * np.nan_to_num(s.u)
        for s in series
        if s.u is not None
        for sign in (-1, 1)
    ]
    low, high = _span([*(s.y for s in series), *reaches])
    marks = ticks(min(low, 0.0), max(high, 0.0))
    horizontal = Scale(*_span([s.x for s in series]), LEFT, WIDTH - RIGHT)
    vertical = Scale(
        marks[0], marks[-1], HEIGHT - BOTTOM, TOP + (8 if len(series) > 1 else 0)
    )
    content = _frame(horizontal, vertical, x_label, y_label)
    for order, one in enumerate(series):
        content += _band(one, horizontal, vertical, order)
    for order, one in enumerate(series):
        content += _chart_line(one, horizontal, vertical, order)
    for one in reversed(series):
        content += _values(one, horizontal, vertical, x_label, y_label)
    if len(series) > 1:
        content += _legend(series)
    return svg.drawing(WIDTH, HEIGHT, label, *content)
