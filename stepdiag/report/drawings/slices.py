"""The error vectors in three planes of equal Z: an arrow shows the components in the plane, a shade
the whole length."""

import numpy as np

from stepdiag.base.volume import Volume
from stepdiag.report.drawings import svg
from stepdiag.report.drawings.space import (
    HEIGHT,
    LATTICE,
    SHADES,
    WIDTH,
    Array,
    lattice_mm,
    shade,
    vector_words,
)

_LEFT, _TOP, _GAP = 30.0, 34.0, 18.0
_LONGEST_PX = 16.0


def slices_drawing(volume: Volume, errors_um: Array, *, longest_um: float, label: str) -> str:
    """Return a drawing of the planes at the lowest, middle and highest Z; ``errors_um`` has the
    shape (LATTICE**3, 3) and the order of `lattice_mm`."""
    points = lattice_mm(volume).reshape(LATTICE, LATTICE, LATTICE, 3)
    errors = errors_um.reshape(LATTICE, LATTICE, LATTICE, 3)
    width = (WIDTH - _LEFT - 2 * _GAP) / 3
    parts = []
    for place, layer in enumerate((0, LATTICE // 2, LATTICE - 1)):
        left = _LEFT + place * (width + _GAP)
        parts.append(
            svg.text(f"Z = {points[0, 0, layer, 2]:.0f} mm", left, _TOP - 14, class_="tick")
        )
        parts += _plane(points[:, :, layer], errors[:, :, layer], left, width, longest_um)
    parts.append(svg.text("X", WIDTH / 2, HEIGHT - 8, class_="axis", text_anchor="middle"))
    parts.append(svg.text("Y", 8, HEIGHT / 2, class_="axis"))
    return svg.drawing(WIDTH, HEIGHT, label, *parts)


def _plane(
    points_mm: Array, errors_um: Array, left: float, width: float, longest_um: float
) -> list[str]:
    """Return the values in the cells of one plane, shape (x, y, 3), X to the right and Y up."""
    count = errors_um.shape[0]
    cell, height = width / count, (HEIGHT - _TOP - 28) / count
    scale = _LONGEST_PX / longest_um if longest_um > 0 else 0.0
    parts = []
    for x in range(count):
        for y in range(count):
            error = errors_um[x, y]
            size = float(np.linalg.norm(error))
            low, top = left + x * cell, HEIGHT - 28 - (y + 1) * height
            level = min(SHADES - 1, shade(size, longest_um))
            parts.append(
                svg.element(
                    "rect", x=low, y=top, width=cell, height=height, class_=f"cell f{level}"
                )
            )
            begin = (low + cell / 2, top + height / 2)
            end = (begin[0] + float(error[0]) * scale, begin[1] - float(error[1]) * scale)
            parts.append(svg.element("path", d=svg.path([begin, end]), class_="arrow"))
            parts.append(
                svg.element("circle", cx=begin[0], cy=begin[1], r=1.4, class_="tail")
            )
            words = vector_words(points_mm[x, y].tolist(), error.tolist())
            parts.append(svg.titled(words, "rect", x=low, y=top, width=cell, height=height))
    return parts


def worst_point(volume: Volume, errors_um: Array) -> tuple[tuple[float, float, float], float]:
    """Return the place of the largest error on the lattice in mm, and its size in um."""
    size = np.linalg.norm(errors_um, axis=1)
    index = int(np.argmax(size))
    x, y, z = lattice_mm(volume)[index].tolist()
    return (x, y, z), float(size[index])
