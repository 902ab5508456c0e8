"""The volume, the route and the stops of a pass for Foxglove's 3D panel: foxglove.SceneUpdate,
lengths in metres.

A viewer that jumps in time receives only the newest message, so each message contains the whole
scene. A long pass is drawn with only its newest stops.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Volume
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.log.topics import VOLUME_TOPIC, Note

LINE_STRIP, LINE_LIST = 0, 2
FRAME = "machine"
STOP_SHARE = 0.012
"""Diameter of a drawn stop as a share of the longest side of the volume."""
MOST_DRAWN = 250
"""Largest number of drawn stops; a route with more stops is drawn as a line between its ends."""
GREY, BLUE = (
    {"r": 0.6, "g": 0.6, "b": 0.6, "a": 1.0},
    {"r": 0.05, "g": 0.36, "b": 0.55, "a": 1.0},
)
GREEN, RED = (
    {"r": 0.08, "g": 0.4, "b": 0.16, "a": 1.0},
    {"r": 0.65, "g": 0.1, "b": 0.1, "a": 1.0},
)
_NOWHERE = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}

Point = Sequence[float]
Route = NDArray[np.float64]


def scene_note(volume: Volume, route_mm: Route, stops: Sequence[CapturedStop]) -> Note:
    """Return the scene after the newest of ``stops``; ``route_mm`` are the planned stops of the
    pass, shape (k, 3).
    """
    size = STOP_SHARE * max(volume.size_mm) * 1e-3
    spheres = [
        {
            "pose": {**_NOWHERE, "position": _metres(stop.position_mm)},
            "size": {"x": size, "y": size, "z": size},
            "color": RED if stop.doubts or stop.refused or stop.broken else GREEN,
        }
        for stop in stops[-MOST_DRAWN:]
    ]
    now = stops[-1].window_to_ns
    entity = {
        "frame_id": FRAME,
        "id": "survey",
        "frame_locked": True,
        "lines": _volume_and_route(volume, route_mm.tobytes()),
        "spheres": spheres,
    }
    return Note(VOLUME_TOPIC, now, {"deletions": [], "entities": [entity]})


@lru_cache(maxsize=2)
def _volume_and_route(volume: Volume, route: bytes) -> list[dict[str, Any]]:
    route_mm = np.frombuffer(route).reshape(-1, 3).tolist()
    drawn_mm = route_mm if len(route_mm) <= MOST_DRAWN else [route_mm[0], route_mm[-1]]
    return [
        _line_entity(LINE_LIST, [point for edge in _edges(volume) for point in edge], GREY),
        _line_entity(LINE_STRIP, drawn_mm, BLUE),
    ]


def _edges(volume: Volume) -> list[tuple[Point, Point]]:
    low, high = (
        volume.origin_mm,
        [start + size for start, size in zip(volume.origin_mm, volume.size_mm, strict=True)],
    )
    corners = [
        [(low, high)[bit][axis] for axis, bit in enumerate(bits)]
        for bits in product((0, 1), repeat=3)
    ]
    return [
        (a, b)
        for a, b in product(corners, corners)
        if a < b and sum(one != other for one, other in zip(a, b, strict=True)) == 1
    ]


def _line_entity(
    kind: int, points_mm: Sequence[Point], color: dict[str, float]
) -> dict[str, Any]:
    return {
        "type": kind,
        "pose": _NOWHERE,
        "thickness": 1.5,
        "scale_invariant": True,
        "points": [_metres(point) for point in points_mm],
        "color": color,
        "indices": [],
    }


def _metres(point_mm: Point) -> dict[str, float]:
    x, y, z = (round(float(value) * 1e-3, 9) for value in point_mm)
    return {"x": x, "y": y, "z": z}
