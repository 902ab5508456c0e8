"""Results of one machine beside each other: what changed, and whether it changed by more than the uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from stepdiag.base.errors import DataError
from stepdiag.base.result.basis import basis_of
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Budget, Facts
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Function, Result
from stepdiag.base.volume import Vector, Volume, anywhere_mm
from stepdiag.conclusion.intervals import reach_of
from stepdiag.solver.model.effects import TURNING

ALMOST = 0.01
"""Of the shortest side: ends of two volumes that differ by less are the same."""
GRID = 11
"""Points per axis of the grid over which volumetric errors are compared."""
TWO_SIGMA = 2 * (1 - NormalDist().cdf(2.0))
"""Chance that one quantity differs by more than k = 2 although nothing changed: 4.6 %."""


Known = tuple[float | None, float | None]
Shares = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """How one quantity changed from the first result to the second.

    For a function, the node where the difference is largest against its uncertainty. ``significant`` is None where one of the results
    does not identify the quantity or states no uncertainty.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    u: float | None
    """Standard uncertainty of the difference."""
    position_mm: float | None = None
    significant: bool | None = None

    @property
    def difference(self) -> float | None:
        """Return after - before."""
        return None if self.before is None or self.after is None else self.after - self.before


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """All changes from one result to another, and the volumetric error of both over their common volume (rms, rigid motion removed): as
    the functions say it, and as intervals at k = 2 (`solver.result.prediction`)."""

    changes: tuple[Change, ...]
    rms_before_um: float
    rms_after_um: float
    before: Interval
    after: Interval
    common: Volume


def coverage_factor(nodes: int) -> float:
    """Return the k at which the largest of ``nodes`` independent differences is as unlikely as one beyond k = 2 (Sidak)."""
    single = 1 - (1 - TWO_SIGMA) ** (1 / max(nodes, 1))
    return NormalDist().inv_cdf(1 - single / 2)


def same_machine(before: Result, after: Result) -> None:
    """Raise ``DataError`` where both results name their machine and the names, or the serial numbers, differ."""
    one, other = (result.survey or Facts() for result in (before, after))
    named = {"machine": (one.machine, other.machine), "machine_serial": (one.machine_serial, other.machine_serial)}
    for entry, (first, second) in named.items():
        if first and second and first != second:
            remedy = "compare results of one machine; where it was only renamed, put the old name into the result's survey.machine"
            raise DataError(
                f"{after.source}: survey.{entry}", expected=f"{first!r} as in {before.source}", found=repr(second), remedy=remedy
            )


def _same_lengths(before: Result, after: Result) -> None:
    """Raise ``DataError`` where one result holds lengths at 20 C and the other as measured: their scales say nothing of each other."""
    first, second = (basis_of(result).tables for result in (before, after))
    if first is not None and second is not None and first != second:
        names = {"as_measured": "lengths as measured", "at_20_c": "lengths at 20 C"}
        remedy = "solve both logs with the same machine.apply_expansion; each result's `lengths` has the scales both ways"
        raise DataError(f"{after.source}: lengths", expected=f"{names[first]} as in {before.source}", found=names[second], remedy=remedy)


def compare(before: Result, after: Result) -> Comparison:
    """Return what changed. Raises ``DataError`` where the results are not of one machine as it stood.

    That is another name or serial number, another chain, no common volume, or lengths at 20 C beside lengths as measured.
    """
    same_machine(before, after)
    _same_lengths(before, after)
    if before.chain != after.chain:
        raise DataError(
            "chain", expected=f"{before.chain} as in the first result", found=after.chain, remedy="compare results of one machine"
        )
    common = _common_volume([before, after])
    rms = [_rms_um(result, common) for result in (before, after)]
    intervals = [_interval(result, common) for result in (before, after)]
    return Comparison(
        changes=_changes(before, after), rms_before_um=rms[0], rms_after_um=rms[1], before=intervals[0], after=intervals[1], common=common
    )


def same_volume(before: Result, after: Result) -> None:
    """Raise ``DataError`` where one result covers another volume: in a smaller one errors are smaller, and nothing was gained."""
    one, other = ((*result.volume.origin_mm, *result.volume.size_mm) for result in (before, after))
    if not np.allclose(one, other, rtol=0.0, atol=ALMOST * min(filter(None, before.volume.size_mm))):
        shown = [f"{tuple(volume[:3])} to {tuple(np.add(volume[:3], volume[3:]).tolist())} mm" for volume in (one, other)]
        remedy = "drive the survey after loading over the volume of the one before"
        raise DataError(f"{after.source}: volume", expected=f"{shown[0]} as in {before.source}", found=shown[1], remedy=remedy)


def _interval(result: Result, common: Volume) -> Interval:
    """Return the volumetric error as found: what the result says of its own volume, as report and page do; drawn again for another."""
    if result.predicted is not None and common.origin_mm == result.volume.origin_mm and common.size_mm == result.volume.size_mm:
        return reach_of(result.predicted).rms_before
    points = anywhere_mm(common)
    return predicted(result, points, np.zeros(points.shape)).without_rigid_motion["before"].rms_um


def _changes(before: Result, after: Result) -> tuple[Change, ...]:
    both = (before, after)
    numbers = []
    for name, q in before.squareness.items():
        other = after.squareness[name]
        numbers.append(_number_change(name, q.unit, (q.value, q.u), (other.value, other.u), _alike(both, name)))
    for name, s in before.scale.items():
        found = after.scale[name]
        numbers.append(_number_change(f"scale {name}", s.unit, (s.value, s.u), (found.value, found.u), _alike(both, name)))
    shared = [name for name in (*DISPLACEMENTS, *ROTATIONS) if name in before.errors and name in after.errors]
    return (*numbers, *(_function_change(name, before.errors[name], after.errors[name], _alike(both, name)) for name in shared))


ALIKE = (*TURNING, "angle origin")
"""Sources that are the same in two surveys of one machine: what nobody measured is in both, and not in their difference."""


def _alike(results: Sequence[Result], name: str) -> Shares:
    """Return for both results which share of a quantity's standard uncertainty the sources of `ALIKE` make; 0 where no budget says it."""
    first, second = (_share(result.budget, name) for result in results)
    return first, second


def _share(budget: Budget | None, name: str) -> float:
    if budget is None or budget.combined.get(name, 0.0) <= 0.0:
        return 0.0
    alike = float(np.linalg.norm([budget.shares.get(name, {}).get(source, 0.0) for source in ALIKE]))
    return min(alike / budget.combined[name], 1.0)


def _u_of_difference(before: Vector, after: Vector, alike: Shares) -> Vector:
    """Return the standard uncertainty of a difference of which each side's share ``alike`` is one cause for both."""
    own = [u * np.sqrt(1.0 - share**2) for u, share in ((before, alike[0]), (after, alike[1]))]
    found: Vector = np.sqrt(own[0] ** 2 + own[1] ** 2 + (alike[1] * after - alike[0] * before) ** 2)
    return found


def _number_change(name: str, unit: str, before: Known, after: Known, alike: Shares) -> Change:
    both = None if before[1] is None or after[1] is None else (np.array(before[1]), np.array(after[1]))
    u = None if both is None else float(_u_of_difference(*both, alike))
    significant = None
    if before[0] is not None and after[0] is not None and u is not None:
        significant = abs(after[0] - before[0]) > coverage_factor(1) * u
    return Change(name=name, unit=unit, before=before[0], after=after[0], u=u, significant=significant)


def _function_change(name: str, before: Function, after: Function, alike: Shares) -> Change:
    """Return the change at the node where it stands out most; shapes where one of the two is a shape only."""
    if before.value is None or after.value is None:
        return Change(name=name, unit=before.unit, before=None, after=None, u=None)
    nodes = _common_nodes(before, after)
    shape = not (before.slope_identified and after.slope_identified) or _other_line(name, before, after)
    a = _from_first(_at(before, before.value, nodes), nodes, shape=shape)
    b = _from_first(_at(after, after.value, nodes), nodes, shape=shape)
    if before.u is None or after.u is None:
        node = int(np.argmax(np.abs(b - a)))
        return _at_node(name, before.unit, nodes, a, b, node)
    u = _u_of_difference(_at(before, before.u, nodes), _at(after, after.u, nodes), alike)
    ratio = np.divide(np.abs(b - a), u, out=np.zeros(len(nodes)), where=u > 0)
    node = int(np.argmax(ratio))
    beyond = bool(ratio[node] > coverage_factor(int(np.count_nonzero(u > 0))))
    return _at_node(name, before.unit, nodes, a, b, node, u=float(u[node]), significant=beyond)


def _at_node(
    name: str, unit: str, nodes: Vector, a: Vector, b: Vector, node: int, *, u: float | None = None, significant: bool | None = None
) -> Change:
    return Change(
        name=name, unit=unit, before=float(a[node]), after=float(b[node]), u=u,
        position_mm=float(nodes[node]), significant=significant,
    )  # fmt: skip


def _other_line(name: str, before: Function, after: Function) -> bool:
    """Return whether two straightnesses refer to different end points, so that only their shapes over the common range compare."""
    same = np.allclose(before.position_mm[[0, -1]], after.position_mm[[0, -1]], atol=1e-6)
    return name in DISPLACEMENTS and name[1] != name[2] and not same


def _common_nodes(before: Function, after: Function) -> Vector:
    """Return the nodes of the coarser function that the other covers too: what lies between its nodes it does not know."""
    coarse, fine = (before, after) if len(before.position_mm) <= len(after.position_mm) else (after, before)
    low, high = fine.position_mm[0] - 1e-6, fine.position_mm[-1] + 1e-6
    nodes: Vector = coarse.position_mm[(coarse.position_mm >= low) & (coarse.position_mm <= high)]
    if len(nodes) < 2:
        raise DataError("errors", expected="functions over a common range", found="no common range", remedy="compare results of one volume")
    return nodes


def _at(function: Function, values: Vector, nodes: Vector) -> Vector:
    """Return a column at other nodes."""
    at: Vector = np.interp(nodes, function.position_mm, values)
    return at


def _from_first(values: Vector, nodes: Vector, *, shape: bool) -> Vector:
    """Return a function relative to its first node; ``shape`` removes the line through the end points."""
    line = (values[-1] - values[0]) * (nodes - nodes[0]) / (nodes[-1] - nodes[0])
    rest: Vector = values - values[0] - (line if shape else 0.0)
    return rest


def _common_volume(results: Sequence[Result]) -> Volume:
    """Return the box that all results cover, without length in an axis that did not travel in one of them.

    Raises ``DataError`` where there is none.
    """
    low = np.max([result.volume.origin_mm for result in results], axis=0)
    high = np.min([np.add(result.volume.origin_mm, result.volume.size_mm) for result in results], axis=0)
    travelled = np.all([result.volume.travelled for result in results], axis=0)
    if np.any((high <= low) & travelled) or not travelled.any():
        raise DataError("volume", expected="volumes that overlap", found="none in common", remedy="compare results of one machine")
    x, y, z = low.tolist()
    a, b, c = np.where(travelled, high - low, 0.0).tolist()
    return Volume(origin_mm=(x, y, z), size_mm=(a, b, c), increments=min(result.volume.increments for result in results))


def _rms_um(result: Result, volume: Volume) -> float:
    axes = [low + size * np.linspace(0.0, 1.0, GRID) for low, size in zip(volume.origin_mm, volume.size_mm, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    errors = without_rigid_motion(volume, points, error_field_um(result, points))
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """One quantity over many results, with its standard uncertainties; None where not identified."""

    name: str
    unit: str
    values: tuple[float | None, ...]
    u: tuple[float | None, ...]


def trend(results: Sequence[Result]) -> tuple[Trend, ...]:
    """Return squareness, scale, the range of each function and the volumetric error over many results, in the order given."""
    common = _common_volume(results)
    first = results[0]
    found = [_trend(name, "urad", [(r.squareness[name].value, r.squareness[name].u) for r in results]) for name in first.squareness]
    found += [_trend(f"scale {name}", "um/m", [(r.scale[name].value, r.scale[name].u) for r in results]) for name in first.scale]
    for name in DISPLACEMENTS:
        found.append(_trend(f"range of {name}", "um", [_range(result.errors[name]) for result in results]))
    found.append(_trend("volumetric error rms", "um", [(_rms_um(result, common), None) for result in results]))
    return tuple(found)


def _trend(name: str, unit: str, known: Sequence[Known]) -> Trend:
    return Trend(name=name, unit=unit, values=tuple(value for value, _ in known), u=tuple(u for _, u in known))


def _range(function: Function) -> Known:
    """Return the range of a function and the uncertainty of the difference of its extremes."""
    if function.value is None:
        return None, None
    low, high = int(np.argmin(function.value)), int(np.argmax(function.value))
    u = None if function.u is None else float(np.hypot(function.u[low], function.u[high]))
    return float(function.value[high] - function.value[low]), u
