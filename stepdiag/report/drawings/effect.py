"""Drawings in separate files, SVG or HTML: the volume before and after compensation on one scale,
and sheets of charts."""

from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from stepdiag.base.messages import message, rendered
from stepdiag.conclusion import Reach
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.report.drawings import charts, space, svg
from stepdiag.texts.texts import Language

SUFFIXES = (".svg", ".html")
TITLE, BEFORE, AFTER = (
    message("field-before-after"),
    message("field-before"),
    message("field-after"),
)
_GAP = 20.0
_HEAD = 46.0
_BELOW = 10.0
_TITLE = 24.0


def effect_drawing(prediction: Prediction, reach: Reach, language: Language) -> str:
    """Return the picture of the effect of tables as SVG markup.

    ``prediction`` contains the measured error less the correction of the tables at
    ``space.LATTICE`` points per axis. ``reach`` contains the intervals for the text above the
    drawings; the intervals also include the errors that the readings do not show.
    """
    shown = prediction.picture()
    fields = [np.array(shown["before_um"]), np.array(shown["after_um"])]
    longest = max(float(np.linalg.norm(field, axis=1).max()) for field in fields)
    parts = [
        svg.element(
            "rect", width="100%", height="100%", style="fill: var(--paper); stroke: none"
        )
    ]
    figures = (
        (BEFORE, reach.rms_before, reach.largest_before),
        (AFTER, reach.rms_after, reach.largest_after),
    )
    for place, ((name, rms, largest), field) in enumerate(zip(figures, fields, strict=True)):
        left = place * (space.WIDTH + _GAP)
        known = (
            rms is not None
            and largest is not None
            and message(
                "figures-of-field", name=name, rms=rms.words(), largest=largest.bound()
            )
        )
        words = rendered(known or name, language)
        drawn = space.field_drawing(prediction.volume, field, longest_um=longest, label=words)
        parts.append(svg.text(words, left + 10, 20, class_="strong"))
        parts.append(
            svg.element(
                "svg", drawn, x=left, y=_HEAD - 18, width=space.WIDTH, height=space.HEIGHT
            )
        )
    factor = space.magnification(prediction.volume, longest)
    parts.append(
        svg.text(
            rendered(message("field-drawn", factor=factor), language), 10, 38, class_="tick"
        )
    )
    return svg.drawing(
        2 * space.WIDTH + _GAP, space.HEIGHT + _HEAD, rendered(TITLE, language), *parts
    )


def sheet(drawings: Sequence[str], title: str, suffix: str, language: Language) -> str:
    """Return a sheet with charts of `stepdiag.report.drawings.charts` below each other under a
    title; ``suffix`` is one of `SUFFIXES`."""
    parts = [
        svg.element(
            "rect", width="100%", height="100%", style="fill: var(--paper); stroke: none"
        ),
        svg.text(title, charts.LEFT, 16, class_="strong"),
    ]
    for place, drawing in enumerate(drawings):
        top = _TITLE + place * (charts.HEIGHT + _BELOW)
        parts.append(
            svg.element("svg", drawing, y=top, width=charts.WIDTH, height=charts.HEIGHT)
        )
    height = _TITLE + len(drawings) * (charts.HEIGHT + _BELOW)
    return drawing_file(
        svg.drawing(charts.WIDTH, height, title, *parts), suffix, title, language
    )


def drawing_file(drawing: str, suffix: str, title: str, language: Language) -> str:
    """Return a drawing as a separate file: SVG, or an HTML page in which a 3-D drawing can be
    turned. ``suffix`` is one of `SUFFIXES`."""
    style = _part("report.css") + ".figure { max-width: none; }"
    if suffix == ".svg":
        head, rest = drawing.split(">", 1)
        return f"{head}><style><![CDATA[{style}]]></style>{rest}\n"
    return (
        '<!doctype html>\n<html lang="' + language + '">\n<head><meta charset="utf-8">'
        f"<title>{title}</title>\n"
        f"<style>{style}</style></head>\n<body>{drawing}\n<script>{_part('report.js')}</script>"
        "</body>\n</html>\n"
    )


def _part(name: str) -> str:
    return files("stepdiag.report").joinpath(name).read_text(encoding="utf-8")
