"""The volumetric error predicted before and after compensation, for the conclusion."""

from dataclasses import dataclass

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.interval import Interval, Predicted
from stepdiag.base.result.result import Result
from stepdiag.base.volume import grid_points_mm
from stepdiag.exporters.safety.verify import NODES, Figures


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """The volumetric error before and after compensation, rigid motion removed: rms over the
    volume, and its largest vector."""

    rms_before: Interval
    largest_before: Interval
    rms_after: Interval | None = None
    largest_after: Interval | None = None


def reach_of(predicted: Predicted) -> Reach:
    before, after = (
        predicted.without_rigid_motion["before"],
        predicted.without_rigid_motion["after"],
    )
    return Reach(
        rms_before=before.rms_um,
        largest_before=before.largest_um,
        rms_after=after.rms_um,
        largest_after=after.largest_um,
    )


def reach_in(result: Result) -> Reach:
    """Return the predicted volumetric error of a result. A result of version 1 gives only the error
    of the machine as found, without its uncertainty."""
    return _as_found(result) if result.predicted is None else reach_of(result.predicted)


def _as_found(result: Result) -> Reach:
    points = grid_points_mm(result.volume, NODES)
    rest = without_rigid_motion(result.volume, points, error_field_um(result, points))
    found = Figures.of(rest)
    return Reach(
        rms_before=Interval(value_um=found.rms_um),
        largest_before=Interval(value_um=found.largest_um),
    )
