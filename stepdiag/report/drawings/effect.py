"""What compensation files do to the volume, as one picture: the error before and after, drawn to one scale."""

from importlib.resources import files

import numpy as np

from stepdiag.conclusion import Reach
from stepdiag.exporters.safety.verify import Prediction
from stepdiag.report.drawings import space, svg

SUFFIXES = (".svg", ".html")
_GAP = 20.0
_HEAD = 46.0


def effect_drawing(prediction: Prediction, reach: Reach) -> str:
    """Return the picture as SVG markup.

    ``prediction`` holds the error at ``space.LATTICE`` points per axis, which are drawn: what was measured, less what the tables take away.
    ``reach`` is what the words over the drawings tell, as intervals: what the readings do not say is in them alone.
    """
    shown = prediction.picture()
    fields = [np.array(shown["before_um"]), np.array(shown["after_um"])]
    longest = max(float(np.linalg.norm(field, axis=1).max()) for field in fields)
    parts = [svg.element("rect", width="100%", height="100%", style="fill: var(--paper); stroke: none")]
    told = (("before", reach.rms_before, reach.largest_before), ("after, predicted", reach.rms_after, reach.largest_after))
    for place, ((name, rms, largest), field) in enumerate(zip(told, fields, strict=True)):
        left = place * (space.WIDTH + _GAP)
        words = name if rms is None or largest is None else f"{name}: rms {rms.words()} µm, largest {largest.bound()} µm (k = 2)"
        drawn = space.field_drawing(prediction.volume, field, longest_um=longest, label=words)
        parts.append(svg.text(words, left + 10, 20, class_="strong"))
        parts.append(svg.element("svg", drawn, x=left, y=_HEAD - 18, width=space.WIDTH, height=space.HEIGHT))
    factor = space.magnification(prediction.volume, longest)
    parts.append(
        svg.text(
            f"drawn is what was measured; rigid motion of the volume removed; errors magnified {factor:.0f} times in both",
            10,
            38,
            class_="tick",
        )
    )
    return svg.drawing(2 * space.WIDTH + _GAP, space.HEIGHT + _HEAD, "volumetric error before and after", *parts)


def effect_file(drawing: str, suffix: str, title: str = "volumetric error before and after") -> str:
    """Return a drawing as a file of its own: SVG, or an HTML page in which a space can be turned. ``suffix`` is one of `SUFFIXES`."""
    style = _part("report.css") + ".figure { max-width: none; }"
    if suffix == ".svg":
        head, rest = drawing.split(">", 1)
        return f"{head}><style><![CDATA[{style}]]></style>{rest}\n"
    return (
        '<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        f"<title>{title}</title>\n"
        f"<style>{style}</style></head>\n<body>{drawing}\n<script>{_part('report.js')}</script></body>\n</html>\n"
    )


def _part(name: str) -> str:
    return files("stepdiag.report").joinpath(name).read_text(encoding="utf-8")
