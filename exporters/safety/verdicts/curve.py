"""The verdict on a table of one axis: the curve that is asked for, and what goes wrong with one in practice.

What does not fit is tried turned in sign, as the table of another axis or function, shifted, and scaled.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.volume import Vector, Volume, rms
from stepdiag.exporters.safety.verdicts.case import TableCase
from stepdiag.exporters.safety.verdicts.measures import ALIKE, POINTS, SAME, SIZED, SPIKE, SURE_UM, centred
from stepdiag.exporters.safety.verdicts.verdict import Code, Judgement
from stepdiag.exporters.safety.verdicts.wanted import Wanted
from stepdiag.exporters.tables.curves import FUNCTIONS, Curve

_OTHER = 0.35
"""What another explanation may leave to be believed."""
_EXACT = 0.1
"""What the table of another function leaves when it is just that."""
COVERED = 0.5
"""Share of the measured travel that a table has to cover."""
_EXCUSED = 0.25
"""Share of a correction that its uncertainty may hide."""


def of_curve(case: TableCase, wanted: Wanted, volume: Volume) -> Judgement:
    own = wanted.as_slope(case.table.name) if case.is_slope else wanted.of(case.table.name)
    if not own:
        return case.says("unidentified", message("result-does-not-identify"))
    own = [case.unstepped(curve) for curve in own]
    plain = replace(case, turn_um_mm=0.0)
    known = _fits(plain, own)
    turned = _fits(case, own) if case.turn_um_mm else []
    right = [fit for fit in (*known, *turned) if fit.is_right]
    if right:
        return _measured(case.says("right", message("what-result-asks-for")), min(right, key=lambda fit: fit.left))
    case = plain
    if known and all(fit.moved_um < fit.sure_um for fit in known):
        return case.says("missing", message("no-correction-where-result", names_um=max(fit.wanted_um for fit in known)))
    return (
        _turned(case, known)
        or _nearly(case, (*known, *turned))
        or _swapped(case, wanted, min((fit.left_scaled for fit in known), default=1.0))
        or _shifted(case, own, volume)
        or _scaled(case, known)
        or case.says("unlike", message("nothing-like-what-result"))
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """What a table does, taken as ``factor`` times what one curve asks for and a rest, over the travel they share.

    ``wanted_um`` and ``moved_um`` are sizes (rms), ``left`` and ``turned`` the share of the curve that the table leaves as it is and with
    the opposite sign, ``off_um`` what the factor makes it too large or small by (rms); what no table of its points holds is taken off. The
    rest has the size ``rest_um`` (rms) and is ``largest_um`` at ``largest_mm``; beyond ``spike_um`` that is no scatter any more.
    """

    wanted_um: float
    moved_um: float
    left: float
    turned: float
    factor: float
    off_um: float
    alike: float
    sure_um: float
    rest_um: float
    largest_um: float
    largest_mm: float
    spike_um: float

    @property
    def is_alike(self) -> bool:
        """Return whether the table corrects the curve in its right size, or both are too small to tell, one place aside."""
        sized = self.off_um <= max(SIZED * self.wanted_um, self.sure_um / 2.0)
        return (self.left <= SAME and sized) or max(self.wanted_um, self.moved_um) < self.sure_um

    @property
    def is_right(self) -> bool:
        """Return whether the table corrects the curve everywhere."""
        return self.is_alike and self.largest_um <= self.spike_um

    @property
    def left_scaled(self) -> float:
        """Return what the table leaves of the curve, as a share, once it is brought to the right size."""
        return float(np.sqrt(max(0.0, 1.0 - self.alike**2)))

    @classmethod
    def of(cls, case: TableCase, curve: Curve, shift_mm: float = 0.0) -> "_Fit | None":
        """Return the comparison; None where the table does not cover the measured travel."""
        position = curve.position_mm[[0, -1]] if case.table.law.ends == "extended" else case.table.position_mm + shift_mm
        first, last = curve.position_mm[[0, -1]]
        low, high = max(first, position[0]), min(last, position[-1])
        if high - low < COVERED * (last - first):
            return None
        at = np.linspace(low, high, POINTS)
        moved = centred(case.moved_um(at - shift_mm) - case.turn_um_mm * at)
        before = case.sum_um(case.before, at - shift_mm)
        # what a table of these points can hold of the whole error, less what acted: fewer points, or others, cannot hold the old one
        asked = before - curve.at(at)
        held = _held(asked, at, position)
        unheld = rms(held - asked)
        wanted = centred(held - before)
        size, size_moved = rms(centred(curve.at(at))) if len(case.before) else rms(wanted), rms(moved)
        # what a survey is unsure of excuses little: the table is judged against what this result asks for, not against the machine
        sure = max(SURE_UM, case.table.quantum_um, min(2.0 * typical_u(curve), _EXCUSED * size))
        turned = rms(moved + wanted) / max(size, sure)
        if not case.is_slope:  # the points of a slope lie anywhere on its line
            moved, wanted = min(((moved, wanted), case.at_own_points_um(curve, at, shift_mm)), key=lambda pair: rms(pair[0] - pair[1]))
        own, product = rms(wanted), float(np.mean(moved * wanted))
        factor = product / own**2 if own > 0 else np.nan
        rest = moved - (factor * wanted if own > 0 else 0.0)
        worst = int(np.argmax(np.abs(rest)))
        bent = wanted - np.polyval(np.polyfit(at, wanted, 1), at)
        return cls(
            wanted_um=size,
            moved_um=size_moved,
            left=float(np.maximum(0.0, rms(moved - wanted) - unheld)) / max(size, sure),
            turned=turned,
            factor=factor,
            off_um=float(np.maximum(0.0, abs(product / own - own) - unheld)) if own > 0 else 0.0,
            alike=product / (own * rms(moved)) if own > 0 and rms(moved) > 0 else 0.0,
            sure_um=sure,
            rest_um=rms(rest),
            largest_um=float(abs(rest[worst])),
            largest_mm=float(at[worst]),
            spike_um=SPIKE * max(sure, SIZED * rms(bent), unheld),
        )


def _fits(case: TableCase, curves: Iterable[Curve]) -> list[_Fit]:
    return [fit for curve in curves if (fit := _Fit.of(case, curve)) is not None]


def _turned(case: TableCase, fits: Iterable[_Fit]) -> Judgement | None:
    if any(fit.turned <= SAME and fit.wanted_um > fit.sure_um for fit in fits):
        return case.says("sign-turned", message("right-shape-with-opposite"), -1.0)
    return None


def _nearly(case: TableCase, fits: Iterable[_Fit]) -> Judgement | None:
    """Return a judgement of a table that corrects most of the curve: too large or too small, or right but for one place."""
    near = [fit for fit in fits if fit.is_alike or fit.left <= SAME]
    if not near:
        return None
    fit = min(near, key=lambda each: each.rest_um)
    if not fit.is_alike:
        return _scaled(case, [fit])
    point_mm = min(case.table.position_mm, key=lambda mm: abs(mm - fit.largest_mm))
    where = f"{case.table.input_axis} {point_mm:g} mm"
    return _measured(case.says("unlike", message("um-off-at-where", largest_um=fit.largest_um, where=where)), fit)


def _measured(judgement: Judgement, fit: _Fit) -> Judgement:
    """Return a judgement with the figures of a comparison."""
    return replace(judgement, factor=fit.factor, rms_um=fit.rest_um, largest_um=fit.largest_um)


def _swapped(case: TableCase, wanted: Wanted, left_scaled: float) -> Judgement | None:
    """Return a judgement where the table is that of another function, the mirrored one of the same two axes first.

    Not where the right shape in another size explains the table as well, unless the other function fits in size and all.
    """
    own = case.table.name
    mirrored = f"E{own[2]}{own[1]}"
    for name in (mirrored, *(each for each in FUNCTIONS if each not in (own, mirrored))):
        for fit in (_Fit.of(case, curve) for curve in wanted.of(name) if name != own):
            if fit is None or fit.wanted_um < 2.0 * fit.sure_um or min(fit.left, fit.turned) > min(_OTHER, max(_EXACT, left_scaled)):
                continue
            code: Code = "input-output-swapped" if name == mirrored else "axes-swapped"
            return case.says(
                code, message("this-table-with-opposite", name=name) if fit.turned < fit.left else message("this-table", name=name)
            )
    return None


def _shifted(case: TableCase, own: Sequence[Curve], volume: Volume) -> Judgement | None:
    """Return a judgement where the table lies elsewhere than the measured volume."""
    if case.table.law.ends == "extended":
        return None
    first, last = case.table.position_mm[[0, -1]]
    axis = AXES.index(case.table.input_axis.lower())
    low, high = volume.origin_mm[axis], volume.origin_mm[axis] + volume.size_mm[axis]
    for shift in (low - first, high - last):
        fits = [_Fit.of(case, curve, shift) for curve in own] if abs(shift) > 1e-6 else []
        if any(fit is not None and fit.left <= _OTHER and fit.wanted_um > fit.sure_um for fit in fits):
            return case.says("beside-volume", message("right-if-it-lay", shift_mm=shift, first_mm=first, last_mm=last))
    if min(last, high) - max(first, low) < COVERED * (high - low):
        return case.says("beside-volume", message("to-mm-measured-travel", first_mm=first, last_mm=last, low_mm=low, high_mm=high))
    return None


def _scaled(case: TableCase, fits: Sequence[_Fit]) -> Judgement | None:
    alike = [fit for fit in fits if abs(fit.alike) >= ALIKE and fit.wanted_um > fit.sure_um]
    if not alike:
        return None
    # two slopes are alike to rounding, whatever their sizes: then the one that the table misses least
    factor = max(alike, key=lambda fit: (round(abs(fit.alike), 6), -fit.left)).factor
    text = message("right-shape-times-as", factor=abs(factor)) if factor < 0 else message("right-shape-other-size", factor=abs(factor))
    return case.says("scaled", text, factor)


def _held(values: Vector, at: Vector, position_mm: Vector) -> Vector:
    """Return what a table with points at ``position_mm`` can hold of values best: straight lines between its points."""
    if len(position_mm) >= POINTS:
        return values
    hats = np.array([np.interp(at, position_mm, row) for row in np.eye(len(position_mm))]).T
    return np.asarray(hats @ np.linalg.lstsq(hats, values, rcond=None)[0])


def typical_u(curve: Curve) -> float:
    """Return the standard uncertainty of a curve in um (rms over its nodes), 0 where nothing is known of it."""
    known = curve.u_um[np.isfinite(curve.u_um)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
