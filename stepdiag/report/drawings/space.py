"""The error field of the volume in 3-D: a wire frame in parallel projection, which can be printed
or turned on a screen."""

import json
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.result.rounding import steady
from stepdiag.base.volume import Volume
from stepdiag.report.drawings import svg

Array = NDArray[np.float64]

AZIMUTH_DEG, ELEVATION_DEG = -58.0, 22.0
"""Initial angles of the view in degrees: X to the right, Y into the sheet, Z up."""
WIDTH, HEIGHT, MARGIN = 460.0, 350.0, 52.0
LATTICE = 5
"""Number of points per axis of the drawn lattice."""
LONGEST_PX = 36.0
"""Length in px of the longest error vector; all errors are magnified by the same factor."""
SHADES = 5


def view_matrix() -> Array:
    """Return the (2, 3) matrix from machine axes to the directions of the sheet (right, up)."""
    azimuth, elevation = np.deg2rad(AZIMUTH_DEG), np.deg2rad(ELEVATION_DEG)
    right = [-np.sin(azimuth), np.cos(azimuth), 0.0]
    up = [
        -np.sin(elevation) * np.cos(azimuth),
        -np.sin(elevation) * np.sin(azimuth),
        np.cos(elevation),
    ]
    return np.array([right, up])


def lattice_mm(volume: Volume, count: int = LATTICE) -> Array:
    """Return ``count`` points per axis over the volume, shape (count**3, 3), z fastest."""
    fractions = np.stack(
        np.meshgrid(*[np.linspace(0.0, 1.0, count)] * 3, indexing="ij"), axis=-1
    ).reshape(-1, 3)
    points: Array = np.asarray(volume.origin_mm) + fractions * np.asarray(volume.size_mm)
    return points


class WireFrame:
    """Points in space in pixels about the middle of the volume, the lines between them, and their
    labels for the pointer."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float]] = []
        self.lines: list[tuple[int, int, str]] = []
        self.values: list[tuple[int, int, str]] = []
        self.names: list[tuple[int, str]] = []

    def add(self, points: Array) -> int:
        """Add points to the frame, shape (N, 3); return the index of the first new point."""
        first = len(self.points)
        self.points += [
            (steady(x, 1), steady(y, 1), steady(z, 1)) for x, y, z in points.tolist()
        ]
        return first

    def markup(self) -> str:
        """Return the drawing of the frame, viewed from `AZIMUTH_DEG`, `ELEVATION_DEG`, with the
        data for a script that turns the view."""
        flat = np.array(self.points) @ view_matrix().T
        at = [(WIDTH / 2 + x, HEIGHT / 2 - y) for x, y in flat.tolist()]
        parts = [
            svg.element("path", d=svg.path([at[a], at[b]]), class_=kind, data_ends=f"{a} {b}")
            for a, b, kind in self.lines
        ]
        parts += [
            svg.titled(words, "path", d=svg.path([at[a], at[b]]), data_ends=f"{a} {b}")
            for a, b, words in self.values
        ]
        for index, name in self.names:
            x, y = at[index]
            parts.append(
                svg.text(
                    name,
                    x,
                    y + 4,
                    class_="axis strong",
                    text_anchor="middle",
                    data_at=str(index),
                )
            )
        return svg.element(
            "g",
            *parts,
            class_="turns",
            data_points=json.dumps(self.points, separators=(",", ":")),
        )


def _px_per_mm(volume: Volume) -> float:
    diagonal = float(np.linalg.norm(volume.size_mm))
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * np.asarray(volume.size_mm)
    reach = 2 * np.abs(corners @ view_matrix().T).max(axis=0)
    return min(
        (WIDTH - 2 * MARGIN) / float(reach[0]),
        (HEIGHT - 2 * MARGIN) / float(reach[1]),
        1.1 * (HEIGHT - MARGIN) / diagonal,
    )


def _add_box(frame: WireFrame, size_px: Array) -> None:
    corners = (
        np.array([[(corner >> axis) & 1 for axis in range(3)] for corner in range(8)]) - 0.5
    )
    first = frame.add(corners * size_px)
    for a, b in (
        (a, b) for a in range(8) for b in range(8) if a < b and (a ^ b) in {1, 2, 4}
    ):
        frame.lines.append((first + a, first + b, "edge origin" if a == 0 else "edge"))
    tips = -0.5 * size_px + np.diag(size_px + 16.0)
    at = frame.add(tips)
    frame.names += [(at + axis, name) for axis, name in enumerate("XYZ")]


def _lattice_lines(count: int) -> Iterator[tuple[int, int]]:
    index = np.arange(count**3).reshape(count, count, count)
    for axis in range(3):
        along = np.moveaxis(index, axis, 2)
        for i, j in product(range(count), repeat=2):
            if {i, j} & {0, count - 1}:
                yield from pairwise(along[i, j].tolist())


def vector_words(point_mm: Sequence[float], error_um: Sequence[float]) -> str:
    place, parts = (
        "; ".join(f"{value:.0f}" for value in point_mm),
        "; ".join(svg.fixed(value) for value in error_um),
    )
    return f"X; Y; Z = {place} mm: {parts} µm, |E| = {svg.fixed(math.hypot(*error_um))} µm"


def shade(magnitude: float, longest: float) -> int:
    """Return the colour class of an error: 0 for the least, SHADES - 1 for the largest."""
    return min(SHADES - 1, int(SHADES * magnitude / longest)) if longest > 0 else 0


def magnification(volume: Volume, longest_um: float) -> float:
    return LONGEST_PX / (longest_um * 1e-3 * _px_per_mm(volume)) if longest_um > 0 else 0.0


def field_drawing(volume: Volume, errors_um: Array, *, longest_um: float, label: str) -> str:
    """Return a drawing of the lattice at the places that the machine really reaches, with magnified
    errors.

    ``errors_um`` has the shape (LATTICE**3, 3) and the order of `lattice_mm`. ``longest_um``
    determines magnification and colours, so drawings with the same ``longest_um`` can be compared.
    """
    px_per_mm = _px_per_mm(volume)
    frame = WireFrame()
    _add_box(frame, np.asarray(volume.size_mm) * px_per_mm)
    middle = np.asarray(volume.origin_mm) + np.asarray(volume.size_mm) / 2
    nominal = (lattice_mm(volume) - middle) * px_per_mm
    scale = LONGEST_PX / longest_um if longest_um > 0 else 0.0
    start, moved = frame.add(nominal), frame.add(nominal + errors_um * scale)
    size = np.linalg.norm(errors_um, axis=1).tolist()
    for a, b in _lattice_lines(LATTICE):
        frame.lines.append(
            (moved + a, moved + b, f"field f{shade(max(size[a], size[b]), longest_um)}")
        )
    for index, magnitude in enumerate(size):
        frame.lines.append(
            (start + index, moved + index, f"error f{shade(magnitude, longest_um)}")
        )
    for index, (point, error) in enumerate(
        zip(lattice_mm(volume).tolist(), errors_um.tolist(), strict=True)
    ):
        frame.values.append((start + index, moved + index, vector_words(point, error)))
    return svg.drawing(WIDTH, HEIGHT, label, frame.markup(), *_key(longest_um))


def _key(longest_um: float) -> list[str]:
    left = WIDTH - 30.0 * SHADES - 10
    parts = [svg.text("µm", left - 6, HEIGHT - 8, class_="tick", text_anchor="end")]
    for index in range(SHADES):
        x = left + index * 30
        parts.append(
            svg.element(
                "rect", x=x, y=HEIGHT - 28, width=30.0, height=7.0, class_=f"key f{index}"
            )
        )
        parts.append(
            svg.text(
                f"{longest_um * (index + 1) / SHADES:.3g}",
                x + 30,
                HEIGHT - 8,
                class_="tick",
                text_anchor="middle",
            )
        )
    return parts
