"""What a prediction says of the volume before and after compensation."""

from collections.abc import Mapping
from dataclasses import dataclass

from stepdiag.exporters.safety.verify import Figures, grid_points_mm
from stepdiag.solver.result.field import error_field_um, without_rigid_motion
from stepdiag.solver.result.interval import Interval, interval_of
from stepdiag.solver.result.result import Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """The volumetric error, rigid motion removed, before and after compensation: rms over the volume and its largest vector."""

    rms_before: Interval
    largest_before: Interval
    rms_after: Interval | None = None
    largest_after: Interval | None = None


def reach_of(predicted: object) -> Reach | None:
    """Return the reach in a ``predicted`` of result or ``verify --json`` (contract 4); None where it does not stand there."""
    figures = predicted.get("without_rigid_motion") if isinstance(predicted, Mapping) else None
    if not isinstance(figures, Mapping):
        return None
    found = {(when, name): _figure(figures.get(when), f"{name}_um") for when in ("before", "after") for name in ("rms", "largest")}
    rms, largest = found["before", "rms"], found["before", "largest"]
    if rms is None or largest is None:
        return None
    return Reach(rms_before=rms, largest_before=largest, rms_after=found["after", "rms"], largest_after=found["after", "largest"])


def _figure(part: object, name: str) -> Interval | None:
    return interval_of(part.get(name)) if isinstance(part, Mapping) else None


def reach_in(result: Result) -> Reach:
    """Return what the result itself predicts; one of version 1 says only how the machine was found, and not how sure that is."""
    return reach_of(result.extra.get("predicted")) or _as_found(result)


def _as_found(result: Result) -> Reach:
    points = grid_points_mm(result.volume)
    rest = without_rigid_motion(result.volume, points, error_field_um(result, points))
    found = Figures.of(rest)
    return Reach(rms_before=Interval(value_um=found.rms_um), largest_before=Interval(value_um=found.largest_um))
