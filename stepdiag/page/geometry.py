"""What the page draws of the volume: its edges, its axes, the diagonals and the route of the pass, in mm; the browser only projects."""

from functools import lru_cache
from itertools import product

from stepdiag.daq.capture.route import base_setup, make_route
from stepdiag.daq.records.status import Snapshot
from stepdiag.solver.geometry.volume import BODY_DIAGONALS, Volume

Point = tuple[float, float, float]
BEYOND = 0.06
"""How far beyond its end the name of an axis stands, as a share of the longest side."""


def geometry(now: Snapshot) -> dict[str, object]:
    """Return edges (pairs of points, those at the origin first), axes (name, place), ways (setup, state, both ends) and the route."""
    volume = Volume(origin_mm=now.origin_mm, size_mm=now.size_mm, increments=now.increments)
    box = _box(volume)
    ways = [
        {"setup": one.name, "state": one.state, "ends_mm": _ends(volume, one.name, now.axis_order)}
        for one in now.setups
        if one.name in BODY_DIAGONALS
    ]
    outward = now.expects_pass % 2 == 1
    route = _route(volume, now.expects_setup, now.axis_order, outward) if now.expects_setup else ()
    return {"edges_mm": box[0], "axes": box[1], "ways": ways, "route_mm": route}


@lru_cache(maxsize=4)
def _box(volume: Volume) -> tuple[tuple[tuple[Point, Point], ...], tuple[tuple[str, Point], ...]]:
    corners = [_corner(volume, bits) for bits in range(8)]
    pairs = [(a, a | bit) for a, bit in product(range(8), (1, 2, 4)) if not a & bit]
    edges = tuple((corners[a], corners[b]) for a, b in sorted(pairs, key=lambda pair: pair[0] != 0))
    far = BEYOND * max(volume.size_mm)
    axes = tuple(("XYZ"[axis], _moved(corners[1 << axis], axis, far)) for axis in range(3))
    return edges, axes


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
    route = _route(volume, base_setup(setup), axis_order, True)
    return route[0], route[-1]
