"""Changes of a machine's errors between results, each with a verdict whether it exceeds its
uncertainty."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.base.result.field import error_field_um, from_first, without_rigid_motion
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Facts
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Function, Result
from stepdiag.base.volume import Vector, Volume, anywhere_mm, grid_points_mm
from stepdiag.comparing.alike import apart, common_share, remarks, same_volume, standing_of
from stepdiag.comparing.chance import DENIABLE, EXCLUDED, Verdict, coverage_factor
from stepdiag.comparing.evolution import beyond
from stepdiag.conclusion.intervals import reach_of

GRID = 11
"""Number of grid points per axis for the comparison of volumetric errors."""

Known = tuple[float | None, float | None]
Shares = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Change of a quantity from the first result to the second.

    The values of a function are those at the node where the change is most significant. ``verdict``
    is None if a result does not identify the quantity or has no uncertainty.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    u: float | None
    """Standard uncertainty of the difference of both values."""
    position_mm: float | None = None
    verdict: Verdict | None = None

    @property
    def difference(self) -> float | None:
        return None if self.before is None or self.after is None else self.after - self.before

    @property
    def significant(self) -> bool | None:
        """Return whether the change is more than chance; None if undecided."""
        return None if self.verdict is None else self.verdict == "changed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """All changes from one result to another, and the volumetric errors of both results over their
    common volume (rms, rigid motion removed): computed from the functions, and as intervals at k =
    2 (`solver.result.prediction`). ``remarks`` contains remarks about the comparison."""

    remarks: tuple[Message, ...]
    changes: tuple[Change, ...]
    rms_before_um: float
    rms_after_um: float
    before: Interval
    after: Interval
    common: Volume


def require_alike(before: Result, after: Result) -> None:
    """Raise ``DataError`` if two results belong to different machines or to different states of a
    machine (`alike.apart`)."""
    first, second = ((result.survey or Facts()).machine for result in (before, after))
    if first and second and first != second:
        remedy = message("compare-renamed")
        raise DataError(
            f"{after.source}: survey.machine",
            expected=message("as-in", value=repr(first), name=before.source),
            found=repr(second),
            remedy=remedy,
        )
    why = apart(standing_of(before), standing_of(after))
    if why is not None:
        raise DataError(
            after.source,
            expected=message("comparable-with", name=before.source),
            found=why,
            remedy=message("compare-one-machine"),
        )


def compare(before: Result, after: Result) -> Comparison:
    """Return the changes. For an unchanged machine, the probability that any change is reported is
    4.6 % (`chance.ERRS`).

    Raises ``DataError`` for results of different machines or states (`require_alike`), or without a
    common volume.
    """
    require_alike(before, after)
    common = _common_volume([before, after])
    rms = [_rms_um(result, common) for result in (before, after)]
    intervals = [_interval(result, common) for result in (before, after)]
    return Comparison(
        remarks=tuple(remarks(standing_of(before), standing_of(after))),
        changes=_judged(before, after),
        rms_before_um=rms[0],
        rms_after_um=rms[1],
        before=intervals[0],
        after=intervals[1],
        common=common,
    )


def require_same_volume(before: Result, after: Result) -> None:
    """Raise ``DataError`` if a result has another volume: errors are smaller in a smaller volume,
    even without a change."""
    if not same_volume(standing_of(before), standing_of(after)):
        boxes = ((each.volume.origin_mm, each.volume.size_mm) for each in (before, after))
        shown = [
            f"{origin} to {tuple(np.add(origin, size).tolist())} mm" for origin, size in boxes
        ]
        remedy = message("same-volume-again")
        raise DataError(
            f"{after.source}: volume",
            expected=message("as-in", value=shown[0], name=before.source),
            found=shown[1],
            remedy=remedy,
        )


def _interval(result: Result, common: Volume) -> Interval:
    if (
        result.predicted is not None
        and common.origin_mm == result.volume.origin_mm
        and common.size_mm == result.volume.size_mm
    ):
        return reach_of(result.predicted).rms_before
    points = anywhere_mm(common)
    return (
        predicted(result, points, np.zeros(points.shape))
        .without_rigid_motion["before"]
        .rms_um
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Asked:
    """A change, and the differences behind it, shapes (nodes,). ``u`` is the part of the
    uncertainty that differs between the surveys, ``whole`` the complete uncertainty."""

    change: Change
    steps: Vector = field(default_factory=lambda: np.zeros(0))
    u: Vector = field(default_factory=lambda: np.zeros(0))
    whole: Vector = field(default_factory=lambda: np.zeros(0))
    place: int = 0


def _judged(before: Result, after: Result) -> tuple[Change, ...]:
    """Return every change with its verdict (`chance.Verdict`). A quantity is "changed" if its
    difference exceeds the largest difference that chance causes in all nodes and numbers together.

    If two surveys scatter more than their U, all quantities are affected. The limit of each
    quantity is therefore widened by the scatter in the median of all differences, unless other
    tables were loaded between the surveys.
    """
    asked = list(_changes(before, after))
    steps, u, whole = (
        np.concatenate([getattr(each, name) for each in asked])
        for name in ("steps", "u", "whole")
    )
    questions = int(np.count_nonzero(u > 0))
    scattered = beyond(
        steps[u > 0], u[u > 0], whole[u > 0], sum(bool(np.any(each.u > 0)) for each in asked)
    )
    one, other = (standing_of(result).compensation for result in (before, after))
    return tuple(
        _with_verdict(each, questions, 0.0 if one != other else scattered) for each in asked
    )


def _with_verdict(asked: _Asked, questions: int, scattered: float) -> Change:
    change = asked.change
    difference, stated = change.difference, change.u
    if not len(asked.u) or difference is None or stated is None:
        return change
    whole = float(asked.whole[asked.place])
    u = math.hypot(stated, scattered * whole)
    if abs(difference) > coverage_factor(questions) * u:
        return replace(change, u=u, verdict="changed")
    hides = abs(difference) + EXCLUDED * u > 2 * DENIABLE * whole
    return replace(change, u=u, verdict="undecided" if hides else "unchanged")


def _changes(before: Result, after: Result) -> Iterator[_Asked]:
    instruments = {standing_of(result).instruments for result in (before, after)}
    shares = partial(_shares, (before, after), same_instruments=len(instruments) == 1)
    for name, q in before.squareness.items():
        other = after.squareness[name]
        yield _number_change(
            name, q.unit, (q.value, q.u), (other.value, other.u), shares(name)
        )
    for name, s in before.scale.items():
        found = after.scale[name]
        yield _number_change(
            f"scale {name}", s.unit, (s.value, s.u), (found.value, found.u), shares(name)
        )
    for name in (*DISPLACEMENTS, *ROTATIONS):
        if name in before.errors and name in after.errors:
            yield _function_change(
                name, before.errors[name], after.errors[name], shares(name)
            )


def _shares(results: Sequence[Result], name: str, *, same_instruments: bool) -> Shares:
    first, second = (
        common_share(result.budget, name, same_instruments=same_instruments)
        for result in results
    )
    return first, second


def _u_of_difference(before: Vector, after: Vector, alike: Shares) -> Vector:
    """Return the standard uncertainty of a difference; the shares ``alike`` of both uncertainties
    have a common cause and cancel."""
    own = [
        u * np.sqrt(1.0 - share**2) for u, share in ((before, alike[0]), (after, alike[1]))
    ]
    found: Vector = np.sqrt(
        own[0] ** 2 + own[1] ** 2 + (alike[1] * after - alike[0] * before) ** 2
    )
    return found


def _number_change(
    name: str, unit: str, before: Known, after: Known, alike: Shares
) -> _Asked:
    if before[1] is None or after[1] is None or before[0] is None or after[0] is None:
        return _Asked(
            change=Change(name=name, unit=unit, before=before[0], after=after[0], u=None)
        )
    u = float(_u_of_difference(np.array(before[1]), np.array(after[1]), alike))
    change = Change(name=name, unit=unit, before=before[0], after=after[0], u=u)
    return _Asked(
        change=change,
        steps=np.array([abs(after[0] - before[0])]),
        u=np.array([u]),
        whole=np.array([math.hypot(before[1], after[1])]),
    )


def _function_change(name: str, before: Function, after: Function, alike: Shares) -> _Asked:
    if before.value is None or after.value is None:
        return _Asked(
            change=Change(name=name, unit=before.unit, before=None, after=None, u=None)
        )
    nodes = _common_nodes(before, after)
    shape = not (before.slope_identified and after.slope_identified) or _other_line(
        name, before, after
    )
    a = from_first(_at_nodes(before, before.value, nodes), nodes, shape=shape)
    b = from_first(_at_nodes(after, after.value, nodes), nodes, shape=shape)
    if before.u is None or after.u is None:
        node = int(np.argmax(np.abs(b - a)))
        return _Asked(change=_at_node(name, before.unit, nodes, a, b, node))
    both = _at_nodes(before, before.u, nodes), _at_nodes(after, after.u, nodes)
    u, whole = _u_of_difference(*both, alike), np.hypot(*both)
    ratio = np.divide(np.abs(b - a), u, out=np.zeros(len(nodes)), where=u > 0)
    node = int(np.argmax(ratio))
    change = _at_node(name, before.unit, nodes, a, b, node, u=float(u[node]))
    return _Asked(change=change, steps=np.abs(b - a), u=u, whole=whole, place=node)


def _at_node(
    name: str,
    unit: str,
    nodes: Vector,
    a: Vector,
    b: Vector,
    node: int,
    *,
    u: float | None = None,
) -> Change:
    return Change(
        name=name,
        unit=unit,
        before=float(a[node]),
        after=float(b[node]),
        u=u,
        position_mm=float(nodes[node]),
    )


def _other_line(name: str, before: Function, after: Function) -> bool:
    same = np.allclose(before.position_mm[[0, -1]], after.position_mm[[0, -1]], atol=1e-6)
    return name in DISPLACEMENTS and name[1] != name[2] and not same


def _common_nodes(before: Function, after: Function) -> Vector:
    """Return the nodes of the coarser function that the finer function covers: the coarser function
    has no values between its nodes."""
    coarse, fine = (
        (before, after)
        if len(before.position_mm) <= len(after.position_mm)
        else (after, before)
    )
    low, high = fine.position_mm[0] - 1e-6, fine.position_mm[-1] + 1e-6
    nodes: Vector = coarse.position_mm[
        (coarse.position_mm >= low) & (coarse.position_mm <= high)
    ]
    if len(nodes) < 2:
        raise DataError(
            "errors",
            expected=message("common-range"),
            found=message("none"),
            remedy=message("compare-one-volume"),
        )
    return nodes


def _at_nodes(function: Function, values: Vector, nodes: Vector) -> Vector:
    at: Vector = np.interp(nodes, function.position_mm, values)
    return at


def _common_volume(results: Sequence[Result]) -> Volume:
    low = np.max([result.volume.origin_mm for result in results], axis=0)
    high = np.min(
        [np.add(result.volume.origin_mm, result.volume.size_mm) for result in results], axis=0
    )
    travelled = np.all([result.volume.travelled for result in results], axis=0)
    if np.any((high <= low) & travelled) or not travelled.any():
        raise DataError(
            "volume",
            expected=message("overlapping-volumes"),
            found=message("none"),
            remedy=message("compare-one-machine"),
        )
    x, y, z = low.tolist()
    a, b, c = np.where(travelled, high - low, 0.0).tolist()
    return Volume(
        origin_mm=(x, y, z),
        size_mm=(a, b, c),
        increments=min(result.volume.increments for result in results),
    )


def _rms_um(result: Result, volume: Volume) -> float:
    points = grid_points_mm(volume, GRID)
    errors = without_rigid_motion(volume, points, error_field_um(result, points))
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """A quantity in several results with its standard uncertainties, None in a result that does not
    identify the quantity."""

    name: str
    unit: str
    values: tuple[float | None, ...]
    u: tuple[float | None, ...]


def trend(results: Sequence[Result]) -> tuple[Trend, ...]:
    """Return the squareness, scale, range of each function and volumetric error of several results,
    in the given order."""
    common = _common_volume(results)
    first = results[0]
    found = [
        _trend(
            name, "urad", [(r.squareness[name].value, r.squareness[name].u) for r in results]
        )
        for name in first.squareness
    ]
    found += [
        _trend(
            f"scale {name}", "um/m", [(r.scale[name].value, r.scale[name].u) for r in results]
        )
        for name in first.scale
    ]
    for name in DISPLACEMENTS:
        found.append(
            _trend(
                f"range of {name}", "um", [_range(result.errors[name]) for result in results]
            )
        )
    found.append(
        _trend(
            "volumetric error rms",
            "um",
            [(_rms_um(result, common), None) for result in results],
        )
    )
    return tuple(found)


def _trend(name: str, unit: str, known: Sequence[Known]) -> Trend:
    return Trend(
        name=name,
        unit=unit,
        values=tuple(value for value, _ in known),
        u=tuple(u for _, u in known),
    )


def _range(function: Function) -> Known:
    if function.value is None:
        return None, None
    low, high = int(np.argmin(function.value)), int(np.argmax(function.value))
    u = None if function.u is None else float(np.hypot(function.u[low], function.u[high]))
    return float(function.value[high] - function.value[low]), u
