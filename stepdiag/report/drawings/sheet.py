"""Several charts on one sheet: a file of its own, SVG or HTML."""

from collections.abc import Sequence

from stepdiag.report.drawings import charts, svg
from stepdiag.report.drawings.effect import SUFFIXES, effect_file

__all__ = ["SUFFIXES", "sheet"]
_GAP = 10.0
_TITLE = 24.0


def sheet(drawings: Sequence[str], title: str, suffix: str) -> str:
    """Return the drawings of `stepdiag.report.drawings.charts` one below the other under a title; ``suffix`` is one of `SUFFIXES`."""
    parts = [
        svg.element("rect", width="100%", height="100%", style="fill: var(--paper); stroke: none"),
        svg.text(title, charts.LEFT, 16, class_="strong"),
    ]
    for place, drawing in enumerate(drawings):
        top = _TITLE + place * (charts.HEIGHT + _GAP)
        parts.append(svg.element("svg", drawing, y=top, width=charts.WIDTH, height=charts.HEIGHT))
    height = _TITLE + len(drawings) * (charts.HEIGHT + _GAP)
    return effect_file(svg.drawing(charts.WIDTH, height, title, *parts), suffix, title)
