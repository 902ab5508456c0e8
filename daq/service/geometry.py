"""What is drawn of a survey: the volume's edges and axes, the ways of its diagonals and the route of the pass, in mm."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.place.route import make_route
from stepdiag.daq.records.status import GeometryStatus, Point, SetupStatus, WayStatus

BEYOND = 0.06
"""How far beyond its end the name of an axis stands, as a share of the longest side."""


def geometry(volume: Volume, axis_order: str, setups: Sequence[SetupStatus], expects: str, *, outward: bool) -> GeometryStatus:
    """Return the geometry of a survey whose pass ``expects`` (empty: none) is awaited or driven."""
    edges, axes = _box(volume)
    ways = tuple(
        WayStatus(setup=one.name, state=one.state, ends_mm=_ends(volume, one.name, axis_order))
        for one in setups
        if one.name in BODY_DIAGONALS
    )
    route = _route(volume, expects, axis_order, outward) if expects else ()
    return GeometryStatus(edges_mm=edges, axes=axes, ways=ways, route_mm=route)


@lru_cache(maxsize=4)
def _box(volume: Volume) -> tuple[tuple[tuple[Point, Point], ...], tuple[tuple[str, Point], ...]]:
    """Return the edges, those at the origin first, and where the names of the axes stand."""
    corners = [_corner(volume, bits) for bits in range(8)]
    pairs = [(a, a | bit) for a, bit in product(range(8), (1, 2, 4)) if not a & bit]
    edges = tuple((corners[a], corners[b]) for a, b in sorted(pairs, key=lambda pair: pair[0] != 0))
    far = BEYOND * max(volume.size_mm)
    return edges, tuple(("XYZ"[axis], _moved(corners[1 << axis], axis, far)) for axis in range(3))


def _corner(volume: Volume, bits: int) -> Point:
    x, y, z = (low + size * ((bits >> axis) & 1) for axis, (low, size) in enumerate(zip(volume.origin_mm, volume.size_mm, strict=True)))
    return x, y, z


def _moved(point: Point, axis: int, far_mm: float) -> Point:
    x, y, z = (value + (far_mm if index == axis else 0.0) for index, value in enumerate(point))
    return x, y, z


@lru_cache(maxsize=64)
def _route(volume: Volume, setup: str, axis_order: str, outward: bool) -> tuple[Point, ...]:
    return tuple((x, y, z) for x, y, z in make_route(volume, setup, axis_order, outward=outward).stops_mm.tolist())


def _ends(volume: Volume, setup: str, axis_order: str) -> tuple[Point, Point]:
    route = _route(volume, setup, axis_order, True)
    return route[0], route[-1]
