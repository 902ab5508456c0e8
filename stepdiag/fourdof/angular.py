"""Rotations of an axis from the passes of an autocollimator or a level, by ISO 230-1 name, with
their uncertainty."""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.survey.models import Head

Turns = dict[str, tuple[Vector, Vector, Vector, Vector]]
"""The rotations measured in a pass: position and value, relative to the first position; the
standard uncertainty in a single pass; the uncertainty common to all passes."""


def turns_of(section: Head, each: Pass) -> Turns:
    """Return the rotations of a pass that the survey file names for its axis (``head.angles.x``).

    The sign of an instrument on the workpiece side is reversed. Raises DataError if the number of
    angles at a stop differs from the number of names.
    """
    axis = each.route.travel.axis
    turns, run = section.angles.turns(axis), section.run_along(axis)
    stops = list(each.chosen().values())
    position = np.array([stop.position_mm[AXES.index(axis)] for stop in stops])
    values, u_values = _columns(stops, len(turns), f"{each.route.setup} pass {each.number}")
    order = np.argsort(position)
    side = 1.0 if run.target_on == "tool" else -1.0
    found: Turns = {}
    for column, turn in enumerate(turns):
        value = side * (1.0 if turn[0] == "+" else -1.0) * values[order, column]
        u = u_values[order, column]
        shared = np.full_like(u, np.sqrt(2.0) * section.angles.u_urad)
        found[f"E{turn[1]}{axis.upper()}"] = (
            position[order],
            value - value[0],
            np.hypot(u, u[0]),
            shared,
        )
    return found


def _columns(stops: Sequence[CapturedStop], wanted: int, name: str) -> tuple[Vector, Vector]:
    """Return the angles at every stop in urad and the standard uncertainties of these means, shapes
    (stops, wanted).
    """
    sizes = {len(stop.channels) for stop in stops}
    if not sizes or min(sizes) < wanted or len(sizes) > 1:
        found = message("number-of-angles", names=list(map(str, sorted(sizes))))
        raise DataError(
            name,
            expected=message("angles-at-every-stop", wanted=wanted),
            found=found,
            remedy=message("drive-once-more"),
        )
    return np.array([stop.channels[:wanted] for stop in stops]), np.array(
        [stop.u_channels[:wanted] for stop in stops]
    )
