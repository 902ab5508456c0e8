"""Is a table the one that the result asks for? Each is compared with what it should be, and with what goes wrong in practice.

The comparison looks at the movement that the control's law makes of the table, with its mean taken off (an origin is nobody's error), and
at the curve that the export would write, as far as the table has points to hold it. What fits neither is tried turned in sign, as the
table of another axis or function, shifted, and scaled.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stepdiag.exporters.safety.standing import Standing, unchanged
from stepdiag.exporters.tables.curves import FOLD_DEFAULT, FUNCTIONS, SQUARENESS_SLOPE, Curve
from stepdiag.exporters.tables.fit import fitted, straight_line_um_mm
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, correction_um, joined, mean_correction_um
from stepdiag.solver.errors import DataError
from stepdiag.solver.geometry.volume import AXES, Vector, Volume
from stepdiag.solver.result.field import error_field_um
from stepdiag.solver.result.result import Result

Code = Literal[
    "right", "empty", "kept", "unidentified", "sign-turned", "axes-swapped", "input-output-swapped", "wrong-measuring-system", "scaled",
    "beside-volume", "unlike",
]  # fmt: skip
HARMLESS: frozenset[Code] = frozenset({"right", "empty", "kept", "unidentified"})
"""Verdicts that do not stop anybody from loading a file."""
_POINTS = 61
SAME = 0.4
"""What a table may leave of what it should correct and still be the right one."""
_OTHER = 0.35
"""What another explanation may leave to be believed."""
_EXACT = 0.1
"""What the table of another function leaves when it is just that."""
ALIKE = 0.9
"""Correlation from which a table counts as the right one in another size."""
_COVERED = 0.5
"""Share of the measured travel that a table has to cover."""
_EXCUSED = 0.25
"""Share of a correction that its uncertainty may hide."""
SURE_UM = 0.2
"""Movements below this are not told from rounding and noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What one table is, in a word for programs and a sentence; ``factor`` is its size against the right one where that is told."""

    table: Table
    code: Code
    text: str
    factor: float | None = None

    @property
    def harmless(self) -> bool:
        """Return whether the table may be loaded as far as this goes."""
        return self.code in HARMLESS

    def as_json(self) -> dict[str, object]:
        """Return the entry of ``verify --json``."""
        return {
            "function": self.table.name,
            "kind": self.table.kind,
            "place": dict(self.table.place),
            "law": self.table.law.describe(),
            "verdict": self.code,
            "factor": None if self.factor is None else round(self.factor, 4),
            "text": self.text,
        }


def judge(result: Result, tables: Sequence[Table], standing: Standing, profile: Profile) -> tuple[Judgement, ...]:
    """Return a judgement for every table, in their order: by what all that act in the control afterwards do, old tables among them.

    Tables that act together (two directions, two kinds for one function) are judged by their sum. One of a function that nobody asked for
    and that goes on as before is "kept".
    """
    after, before = standing.acting(result, profile)
    wanted = _Wanted(result)
    turns = _turns(wanted, after, before, result.volume)
    judged = []
    for table in tables:
        fault = _measuring_system(table, profile) or _kept(table, standing, profile)
        if fault is None:
            acting = [[each for each in some if _acts_with(each, table)] for some in (after, before)]
            case = _Case(table, acting[0], acting[1], result.volume, turns.get(table.name, 0.0))
            fault = _emptied(case)
        if fault is None:
            fault = _of_product(case, result) if table.multiplier is not None else _of_curve(case, wanted, result.volume)
        judged.append(fault)
    return tuple(judged)


@dataclass(frozen=True, slots=True)
class _Case:
    """One table, all that act ``together`` with it, what acted ``before``, and the measured volume."""

    table: Table
    together: Sequence[Table]
    before: Sequence[Table]
    volume: Volume
    turn_um_mm: float = 0.0
    """What a turn of the workpiece adds to the slope of the curve: nobody's error."""

    @property
    def is_slope(self) -> bool:
        """Return whether the table is one number, the slope of a straight line."""
        return len(self.table.position_mm) == 2 and self.table.law.ends == "extended"

    def moved_um(self, position_mm: Vector) -> Vector:
        """Return what the tables add to what was active, mean of both directions, steps joined by straight lines, in um.

        Of a product that counts which is the same everywhere in the volume: its mean over the other axis.
        """
        return self.sum_um(self.together, position_mm) - self.sum_um(self.before, position_mm)

    def sum_um(self, tables: Sequence[Table], position_mm: Vector) -> Vector:
        """Return what some of these tables do at positions, mean of both directions, steps joined by straight lines, in um."""
        ways = [self._along(joined(each), position_mm, way) for each in tables for way in (1, -1)]
        return np.asarray(sum(ways, np.zeros(position_mm.shape)) / 2.0)

    def unstepped(self, curve: Curve) -> Curve:
        """Return a residual without the steps of what acted while it was measured: no table asks for them (`tables.merge`)."""
        stepped = [each for each in self.before if each.law.between == "stepped" and each.multiplier is None]
        if not stepped:
            return curve
        at = curve.position_mm
        steps = sum(
            ((correction_um(each, at, way) - correction_um(joined(each), at, way)) / 2.0 for each in stepped for way in (1, -1)), 0.0 * at
        )
        return replace(curve, forward_um=curve.at(at) - steps, reverse_um=None)

    def off_um(self, curve: Curve, at: Vector, shift_mm: float) -> Vector:
        """Return how far the table is from one that has, at its own points, all that acted before and what the curve asks for."""
        own = self.table.position_mm + shift_mm
        wanted = self.sum_um(self.before, own - shift_mm) - curve.at(own)
        return _centred(self.sum_um(self.together, at - shift_mm) - self.turn_um_mm * at - np.interp(at, own, wanted))

    def _along(self, table: Table, position_mm: Vector, way: int) -> Vector:
        """Return what a table moves along the input axis of the judged one."""
        if table.multiplier is None:
            return correction_um(table, position_mm, way)
        own, by = self.table.input_axis, table.multiplier.axis
        moved = correction_um(table, position_mm if table.input_axis == own else self._travel_mm(table.input_axis), way)
        times = table.multiplier.at(position_mm if by == own else self._travel_mm(by))
        if table.input_axis != own:
            moved = np.full(position_mm.shape, np.mean(moved))
        return np.asarray(moved * (times if by == own else np.mean(times)))

    def _travel_mm(self, letter: str) -> Vector:
        axis = AXES.index(letter.lower())
        return self.volume.origin_mm[axis] + self.volume.size_mm[axis] * np.linspace(0.0, 1.0, _POINTS)

    def moved_field_um(self) -> Vector:
        """Return what the tables add to what was active on the grid of `grid_mm`, along the output axis."""
        points, axis = grid_mm(self.volume), AXES.index(self.table.output_axis.lower())
        moved = mean_correction_um(self.together, points) - mean_correction_um(self.before, points)
        return np.asarray(moved[:, axis].reshape(NODES, NODES, NODES))

    def says(self, code: Code, text: str, factor: float | None = None) -> Judgement:
        return Judgement(table=self.table, code=code, text=f"{self.table.label}: {text}", factor=factor)


class _Wanted:
    """The curves that the result asks for, each squareness in one or the other of its two functions."""

    def __init__(self, result: Result) -> None:
        other = {name: next(one for one in slopes if one != FOLD_DEFAULT[name]) for name, slopes in SQUARENESS_SLOPE.items()}
        self._curves: dict[str, list[Curve]] = {name: [] for name in FUNCTIONS}
        for name in FUNCTIONS:
            for fold in (FOLD_DEFAULT, other):
                try:
                    self._curves[name] += fitted(result, [name], fold).curves
                except DataError:
                    continue

    def of(self, name: str) -> list[Curve]:
        return self._curves.get(name, [])

    def as_slope(self, name: str) -> list[Curve]:
        """Return the curves for a control that holds one slope for both functions of a pair of axes: that of the other one is added."""
        plain = [curve for curve in self.of(f"E{name[2]}{name[1]}") if not any(part in SQUARENESS_SLOPE for part in curve.parts)]
        slope = straight_line_um_mm(plain[0]) if plain else 0.0
        return [replace(curve, forward_um=curve.forward_um + slope * curve.position_mm, reverse_um=None) for curve in self.of(name)]


def _turns(wanted: _Wanted, after: Sequence[Table], before: Sequence[Table], volume: Volume) -> dict[str, float]:
    """Return, for each two functions of one pair of axes that both have tables, the slopes in um/mm that are a turn of the workpiece.

    Old tables, levers and the choice of the function that holds a squareness move such a turn from one calibration into the next: it raises
    one function by as much as it lowers the other.
    """
    found: dict[str, float] = {}
    for one, other in (("EXY", "EYX"), ("EXZ", "EZX"), ("EYZ", "EZY")):
        slopes = []
        for name in (one, other):
            tables = [table for table in after if table.name == name and table.multiplier is None]
            curves = wanted.of(name)
            if tables and curves:
                acting = [[each for each in some if _acts_with(each, tables[0])] for some in (after, before)]
                first, last = curves[0].position_mm[[0, -1]]
                at = np.linspace(first, last, _POINTS)
                off = _Case(tables[0], acting[0], acting[1], volume).moved_um(at) + curves[0].at(at)
                slopes.append(float(np.polyfit(at, off, 1)[0]))
        if len(slopes) == 2:
            found |= {one: (slopes[0] - slopes[1]) / 2.0, other: (slopes[1] - slopes[0]) / 2.0}
    return found


def _acts_with(one: Table, other: Table) -> bool:
    """Return whether ``one`` counts for the judgement of ``other``: the same function, and of a curve what products do along its axis.

    Products of one function and lever count together, wherever they stand: a new one may do the work of an old one under other numbers.
    """
    if other.multiplier is not None:
        return one.multiplier is not None and one.name == other.name and one.multiplier.axis == other.multiplier.axis
    if one.multiplier is None:
        return one.name == other.name
    return one.output_axis == other.output_axis and other.input_axis in (one.input_axis, one.multiplier.axis)


def _measuring_system(table: Table, profile: Profile) -> Judgement | None:
    system, used = table.place.get("measuring system"), getattr(profile.options, "measuring_system", None)
    if profile.assumed or system is None or used is None or system == used:
        return None
    text = f"{table.label}: written for measuring system {system}, the profile says that {used} is in use: it would not act"
    return Judgement(table=table, code="wrong-measuring-system", text=text)


def _kept(table: Table, standing: Standing, profile: Profile) -> Judgement | None:
    """Return a judgement where a function that nobody asked for moves the axis as it did before."""
    if table.name in profile.machine.functions or table.multiplier is not None:
        return None
    then, now = ([each for each in some if each.name == table.name] for some in (standing.before, standing.after))
    if not then or not now or not unchanged(now, then):
        return None
    return Judgement(table=table, code="kept", text=f"{table.label}: as it was in the control before")


def _emptied(case: _Case) -> Judgement | None:
    """Return a judgement of zeros beside another table that does the work."""
    if case.table.value_um.any() or not any(each.value_um.any() for each in case.together):
        return None
    return case.says("empty", "zeros: nothing acts from this place any more")


def _of_curve(case: _Case, wanted: _Wanted, volume: Volume) -> Judgement:
    own = wanted.as_slope(case.table.name) if case.is_slope else wanted.of(case.table.name)
    if not own:
        return case.says("unidentified", "the result does not identify what it corrects: nothing to compare it with")
    own = [case.unstepped(curve) for curve in own]
    plain = replace(case, turn_um_mm=0.0)
    known, turned = ([fit for curve in own if (fit := _Fit.of(each, curve)) is not None] for each in (plain, case))
    if any(fit.is_right for fit in (*known, *turned)):
        return case.says("right", "what the result asks for", min((*known, *turned), key=lambda fit: fit.left).factor)
    case = plain
    if known and all(fit.moved_um < fit.sure_um for fit in known):
        return case.says("empty", f"no correction, where the result asks for {max(fit.wanted_um for fit in known):.1f} um")
    return (
        _turned(case, known)
        or _swapped(case, wanted, min((fit.left_scaled for fit in known), default=1.0))
        or _shifted(case, own, volume)
        or _scaled(case, known)
        or case.says("unlike", "nothing like what the result asks for: of another machine, another survey, or damaged")
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """A table against one curve, over the travel they share: sizes in um (rms), what it leaves as a share, and its factor."""

    wanted_um: float
    moved_um: float
    left: float
    turned: float
    factor: float
    alike: float
    sure_um: float

    @property
    def is_right(self) -> bool:
        """Return whether the table corrects the curve, or both are too small to tell."""
        return self.left <= SAME or max(self.wanted_um, self.moved_um) < self.sure_um

    @property
    def left_scaled(self) -> float:
        """Return what the table leaves of the curve, as a share, once it is brought to the right size."""
        return float(np.sqrt(max(0.0, 1.0 - self.alike**2)))

    @classmethod
    def of(cls, case: _Case, curve: Curve, shift_mm: float = 0.0) -> "_Fit | None":
        """Return the comparison; None where the table does not cover the measured travel."""
        position = curve.position_mm[[0, -1]] if case.table.law.ends == "extended" else case.table.position_mm + shift_mm
        first, last = curve.position_mm[[0, -1]]
        low, high = max(first, position[0]), min(last, position[-1])
        if high - low < _COVERED * (last - first):
            return None
        at = np.linspace(low, high, _POINTS)
        moved = _centred(case.moved_um(at - shift_mm) - case.turn_um_mm * at)
        wanted = _centred(_held(-curve.at(at), at, position))
        size, size_moved = rms(wanted), rms(moved)
        # what a survey is unsure of excuses little: the table is judged against what this result asks for, not against the machine
        sure = max(SURE_UM, case.table.quantum_um, min(2.0 * _typical_u(curve), _EXCUSED * size))
        product = float(np.mean(moved * wanted))
        return cls(
            wanted_um=size,
            moved_um=size_moved,
            left=min(rms(moved - wanted), rms(case.off_um(curve, at, shift_mm))) / max(size, sure),
            turned=rms(moved + wanted) / max(size, sure),
            factor=product / size**2 if size > 0 else np.nan,
            alike=product / (size * size_moved) if size > 0 and size_moved > 0 else 0.0,
            sure_um=sure,
        )


def _turned(case: _Case, fits: Iterable[_Fit]) -> Judgement | None:
    if any(fit.turned <= SAME and fit.wanted_um > fit.sure_um for fit in fits):
        return case.says("sign-turned", "the right shape with the opposite sign: it would double the error", -1.0)
    return None


def _swapped(case: _Case, wanted: _Wanted, left_scaled: float) -> Judgement | None:
    """Return a judgement where the table is that of another function, the mirrored one of the same two axes first.

    Not where the right shape in another size explains the table as well, unless the other function fits in size and all.
    """
    own = case.table.name
    mirrored = f"E{own[2]}{own[1]}"
    for name in (mirrored, *(each for each in FUNCTIONS if each not in (own, mirrored))):
        for fit in (_Fit.of(case, curve) for curve in wanted.of(name) if name != own):
            if fit is None or fit.wanted_um < 2.0 * fit.sure_um or min(fit.left, fit.turned) > min(_OTHER, max(_EXACT, left_scaled)):
                continue
            turned = " with the opposite sign" if fit.turned < fit.left else ""
            code: Code = "input-output-swapped" if name == mirrored else "axes-swapped"
            return case.says(code, f"this is the table of {name}{turned}")
    return None


def _shifted(case: _Case, own: Sequence[Curve], volume: Volume) -> Judgement | None:
    """Return a judgement where the table lies elsewhere than the measured volume."""
    if case.table.law.ends == "extended":
        return None
    first, last = case.table.position_mm[[0, -1]]
    axis = AXES.index(case.table.input_axis.lower())
    low, high = volume.origin_mm[axis], volume.origin_mm[axis] + volume.size_mm[axis]
    for shift in (low - first, high - last):
        fits = [_Fit.of(case, curve, shift) for curve in own] if abs(shift) > 1e-6 else []
        if any(fit is not None and fit.left <= _OTHER and fit.wanted_um > fit.sure_um for fit in fits):
            return case.says("beside-volume", f"right if it lay {shift:+g} mm from where it lies ({first:g} to {last:g} mm)")
    if min(last, high) - max(first, low) < _COVERED * (high - low):
        return case.says("beside-volume", f"{first:g} to {last:g} mm, the measured travel is {low:g} to {high:g} mm")
    return None


def _scaled(case: _Case, fits: Sequence[_Fit]) -> Judgement | None:
    alike = [fit for fit in fits if abs(fit.alike) >= ALIKE and fit.wanted_um > fit.sure_um]
    if not alike:
        return None
    factor = max(alike, key=lambda fit: abs(fit.alike)).factor
    sign = " and turned in sign" if factor < 0 else ""
    return case.says("scaled", f"the right shape, {abs(factor):.3g} times as large as it should be{sign}", factor)


def _of_product(case: _Case, result: Result) -> Judgement:
    """Return the judgement of a product table: it is compared with the part of the field that grows with the same lever."""
    multiplier = case.table.multiplier
    if multiplier is None or multiplier.axis == case.table.input_axis:
        return case.says("right", "a lever along the axis itself: what it does is judged with the curve of that axis")
    moving, by = (AXES.index(letter.lower()) for letter in (case.table.input_axis, multiplier.axis))
    moved = -growing_um(case.moved_field_um(), moving, by)
    asked = growing_um(_field_um(result, case.table), moving, by)
    size, wanted = rms(moved), rms(asked)
    if size < SURE_UM / 2:
        return case.says("empty", "no correction")
    if wanted < SURE_UM / 2:
        return case.says("unlike", "the field of the result holds nothing like this product")
    factor, alike = float(np.mean(moved * asked)) / wanted**2, float(np.mean(moved * asked)) / (size * wanted)
    if rms(moved - asked) <= max(SAME * wanted, SURE_UM / 2):
        return case.says("right", "what the result asks for", factor)
    if rms(moved + asked) <= SAME * wanted:
        return case.says("sign-turned", "a product with the opposite sign: it would double what it should correct", -1.0)
    if abs(alike) < ALIKE:
        return case.says("unlike", "the field of the result holds nothing like this product")
    sign = " and turned in sign" if factor < 0 else ""
    return case.says("scaled", f"{abs(factor):.3g} times as large as it should be{sign}", factor)


def _field_um(result: Result, table: Table) -> Vector:
    """Return the error of the output axis of a table on the grid of `grid_mm`."""
    axis = AXES.index(table.output_axis.lower())
    return np.asarray(error_field_um(result, grid_mm(result.volume))[:, axis].reshape(NODES, NODES, NODES))


def growing_um(values: Vector, moving: int, by: int) -> Vector:
    """Return, at the nodes of the axis ``moving``, what of values on a grid grows with the lever along ``by``, at the end of the lever."""
    (other,) = {0, 1, 2} - {moving, by}
    lever = np.linspace(-1.0, 1.0, NODES)
    flat = np.mean(np.moveaxis(_without_curves(values), (moving, by, other), (0, 1, 2)), axis=2)
    return np.asarray(flat @ lever / np.sum(lever**2))


NODES = 9


def grid_mm(volume: Volume) -> Vector:
    """Return the points at which fields are compared, shape (nodes ** 3, 3), z fastest."""
    axes = [low + size * np.linspace(0.0, 1.0, NODES) for low, size in zip(volume.origin_mm, volume.size_mm, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _without_curves(values: Vector) -> Vector:
    """Return what is left of values on a grid without their means along each axis: no curve of one axis can hold it."""
    left = values - np.mean(values)
    for axes in ((1, 2), (0, 2), (0, 1)):
        left = left - np.mean(left, axis=axes, keepdims=True)
    return np.asarray(left)


def _held(values: Vector, at: Vector, position_mm: Vector) -> Vector:
    """Return what a table with points at ``position_mm`` can hold of values best: straight lines between its points."""
    if len(position_mm) >= _POINTS:
        return values
    hats = np.array([np.interp(at, position_mm, row) for row in np.eye(len(position_mm))]).T
    return np.asarray(hats @ np.linalg.lstsq(hats, values, rcond=None)[0])


def _typical_u(curve: Curve) -> float:
    known = curve.u_um[np.isfinite(curve.u_um)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def _centred(values: Vector) -> Vector:
    return np.asarray(values - np.mean(values))


def rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def worst(judgements: Iterable[Judgement]) -> Iterator[Judgement]:
    """Yield the judgements for which a file must not be loaded."""
    return (each for each in judgements if not each.harmless)
