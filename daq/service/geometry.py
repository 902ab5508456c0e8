"""The drawing of a survey in mm."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product

from stepdiag.base.readings.runs import Plan
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.naming.route import route_of
from stepdiag.daq.records.status import GeometryStatus, Point, SetupStatus, WayStatus

BEYOND = 0.06
"""Distance of the name of an axis beyond the end of the axis, as a share of the longest side."""


def geometry(
    plan: Plan, setups: Sequence[SetupStatus], expects: str, number: int
) -> GeometryStatus:
    """Return the drawing of a survey. ``number`` is the next or running pass of the setup
    ``expects`` (empty: none).
    """
    edges, axes = _box(plan.volume)
    ways = tuple(
        WayStatus(setup=one.name, state=one.state, ends_mm=_ends(plan, one.name))
        for one in setups
    )
    route = _route(plan, expects, number) if expects else ()
    return GeometryStatus(edges_mm=edges, axes=axes, ways=ways, route_mm=route)


@lru_cache(maxsize=4)
def _box(
    volume: Volume,
) -> tuple[tuple[tuple[Point, Point], ...], tuple[tuple[str, Point], ...]]:
    corners = [_corner(volume, bits) for bits in range(8)]
    pairs = [(a, a | bit) for a, bit in product(range(8), (1, 2, 4)) if not a & bit]
    edges = tuple(
        (corners[a], corners[b]) for a, b in sorted(pairs, key=lambda pair: pair[0] != 0)
    )
    far = BEYOND * max(volume.size_mm)
    return edges, tuple(
        ("XYZ"[axis], _moved(corners[1 << axis], axis, far)) for axis in range(3)
    )


def _corner(volume: Volume, bits: int) -> Point:
    x, y, z = (
        low + size * ((bits >> axis) & 1)
        for axis, (low, size) in enumerate(zip(volume.origin_mm, volume.size_mm, strict=True))
    )
    return x, y, z


def _moved(point: Point, axis: int, far_mm: float) -> Point:
    x, y, z = (
        value + (far_mm if index == axis else 0.0) for index, value in enumerate(point)
    )
    return x, y, z


@lru_cache(maxsize=64)
def _route(plan: Plan, setup: str, number: int) -> tuple[Point, ...]:
    return tuple((x, y, z) for x, y, z in route_of(plan, setup, number).stops_mm.tolist())


def _ends(plan: Plan, setup: str) -> tuple[Point, Point]:
    route = _route(plan, setup, 1)
    return route[0], route[-1]
