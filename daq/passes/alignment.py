"""The mirror tilt from the first steps of a pass, early enough to realign the mirror during the
pass.

If the normal of the mirror differs from the diagonal by ``nu``, every step of axis a has the
constant error ``nu_a * step_a`` (theory.md 4.2). The slopes of the machine, tens of microradians,
count as tilt, too.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.capture.naming.route import Route
from stepdiag.daq.passes.stretches import OnZero

POSSIBLE_MRAD = 20.0
"""Largest tilt in mrad of a mirror that reflects the beam into the head. A larger slope of the
steps has another cause. The value is chosen, not measured.
"""


def mirror_tilt_mrad(route: Route, stops: Sequence[OnZero]) -> tuple[float, float] | None:
    """Return the tilt of the mirror against the diagonal in mrad: sideways and upwards, viewed
    along the beam.

    None for a run along one axis, before every axis has made a step between two good stops, and for
    a tilt above `POSSIBLE_MRAD`.
    """
    if not route.travel.is_diagonal or len(stops) < 4:
        return None
    sideways, upwards = _across(route)
    rows, wrong = [], []
    for before, after in pairwise(stops):
        if (
            after.stop != before.stop + 1
            or after.refused
            or math.isnan(after.reading_mm - before.reading_mm)
        ):
            continue
        step = np.subtract(after.position_mm, before.position_mm)
        rows.append([step @ sideways, step @ upwards])
        nominal = route.nominal_at_mm(after.position_mm) - route.nominal_at_mm(
            before.position_mm
        )
        wrong.append(after.reading_mm - before.reading_mm - nominal)
    moved = {stop.axis for stop in stops[1:]}
    if len(moved) < 3 or len(rows) < 3:
        return None
    tilt = np.linalg.lstsq(np.array(rows), np.array(wrong), rcond=None)[0] * 1e3
    return None if np.max(np.abs(tilt)) > POSSIBLE_MRAD else (float(tilt[0]), float(tilt[1]))


def tilt_effect_um(
    route: Route, tilt_mrad: tuple[float, float], stops: Sequence[int]
) -> NDArray[np.float64]:
    """Return the effect of a mirror tilt on the readings at ``stops`` of a route in um, shape (k,),
    relative to the first stop of the route.
    """
    way = route.stops_mm[list(stops)] - route.stops_mm[0]
    effect: NDArray[np.float64] = way @ np.column_stack(_across(route)) @ np.array(tilt_mrad)
    return effect


def _across(route: Route) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors, sideways and upwards as viewed along the beam of a body diagonal on
    an outward pass.
    """
    along = (route.stops_mm[-1] - route.stops_mm[0]) / abs(route.nominal_mm[-1])
    along = along if route.nominal_mm[-1] > 0 else -along
    sideways = np.cross([0.0, 0.0, 1.0], along)
    sideways /= np.linalg.norm(sideways)
    return sideways, np.cross(along, sideways)
