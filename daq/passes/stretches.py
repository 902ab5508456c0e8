"""The stretches of unbroken count of one pass, and the offsets that give the stretches a common
zero.

A laser that loses its count continues from another zero. A stop that is measured before and after
the loss gives the offset between the two zeros, if mirror and setup are unchanged; all such stops
must then give the same offset.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from stepdiag.base.messages import Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop

SAME_UM = 1.5
"""Largest difference in um between two measurements of a stop within a count, from the
repeatability and the drift of a good machine. A larger difference is a loss of the laser's count.
"""
SURE = 3.0
"""Largest difference between two readings of a stop, in combined standard uncertainties of readings
and machine.
"""


def same_um(repeatability_um: float) -> float:
    """Return the largest difference in um between two measurements of a stop within a count, for a
    machine with this repeatability (k = 1).
    """
    return max(SAME_UM, SURE * float(np.sqrt(2.0)) * repeatability_um)


class OnZero(CapturedStop, frozen=True, kw_only=True):
    """A stop whose ``reading_mm`` counts from the zero of its pass; NaN without a reading of the
    laser.

    Every display or comparison of readings uses this type, because the raw count of the laser has
    another zero after every loss.
    """

    reading_mm: float


def on_zero(stop: CapturedStop, offset_mm: float) -> OnZero:
    """Return a stop with the reading on the zero of its pass: the captured reading plus the offset
    of the stretch in mm.
    """
    values = {name: getattr(stop, name) for name in stop.__struct_fields__}
    counted_mm = math.nan if stop.reading_mm is None else stop.reading_mm
    return OnZero(**{**values, "reading_mm": counted_mm + offset_mm})


@dataclass(frozen=True, slots=True)
class Measured:
    """A measurement of a stop: the captured stop, its stretch of unbroken count, and its visit.
    Successive measurements without another stop between them are one visit.
    """

    stop: CapturedStop
    stretch: int
    visit: int = 0
    nominal_mm: float = 0.0
    """The nominal reading in mm at the machine's position; the positions of two visits differ by
    the scatter of encoders and the rounding of programs.
    """

    @property
    def beside_mm(self) -> float:
        """Return the reading minus the nominal reading in mm, which is comparable between
        visits.
        """
        return (self.stop.reading_mm or 0.0) - self.nominal_mm


@dataclass(frozen=True, slots=True)
class Zero:
    """Offset in mm from the readings of a stretch to the zero of the pass; ``doubt`` is the reason
    of a doubtful offset.

    ``code`` is the code of the doubt's finding; ``size_um`` is the possible error of the stretch in
    um, if known.
    """

    offset_mm: float
    doubt: Words = ""
    code: str = ""
    size_um: float | None = None


@dataclass(slots=True)
class Unwatched:
    """A time between two stretches in which the count may have been lost: the earlier stretch, the
    first stop afterwards, the reason, and the code of the finding.

    ``proven`` means that the sample number of the instrument and the other passes prove an unbroken
    count. ``unproven`` is the reason why existing sample numbers and passes prove nothing.
    """

    before: int
    stop: int
    why: Words
    code: str
    proven: bool = False
    unproven: Words = ""

    @property
    def doubt(self) -> Words:
        """Return the reason to doubt the count over the unwatched time; empty for a count that is
        proven to be unbroken.
        """
        if self.proven:
            return ""
        if self.unproven:
            return message(
                "before-stop.unproven", why=self.why, stop=self.stop, unproven=self.unproven
            )
        return message("before-stop", why=self.why, stop=self.stop)


@dataclass(frozen=True, slots=True)
class Slip:
    """A stop whose reading differs from its earlier reading although the laser reported no loss."""

    stop: int
    size_um: float


Zeros = dict[int, Zero]


@dataclass(slots=True)
class Stretches:
    """The stretches of count of a pass: measurements by stop, in the order of capture."""

    same_um: float = SAME_UM
    """Largest difference in um between two measurements of a stop."""
    measured: dict[int, list[Measured]] = field(default_factory=dict)
    unwatched: dict[int, Unwatched] = field(default_factory=dict)
    """The unwatched time before a stretch, by the number of the stretch; missing without an
    unwatched time.
    """
    slips: dict[int, Slip] = field(default_factory=dict)
    """The slip at the beginning of a stretch, by stretch."""

    def differs_um(self, now: Measured) -> float | None:
        """Return the increase in um of a stop's reading within its stretch; None if the stretch has
        no earlier reading of this stop, or the readings agree.
        """
        same = [
            entry
            for entry in self.measured.get(now.stop.stop, ())
            if entry.stretch == now.stretch and _of_one_count(entry.stop)
        ]
        if not same or now.stop.reading_mm is None or same[-1].stop.reading_mm is None:
            return None
        off_um = (now.beside_mm - same[-1].beside_mm) * 1e3
        return (
            off_um
            if abs(off_um)
            > self.same_um + SURE * float(np.hypot(now.stop.u_um, same[-1].stop.u_um))
            else None
        )

    def zeros(self, stops: int) -> Zeros:
        """Return the zero of every stretch that can be joined, for a pass with the given number of
        stops.

        The stretch of the first stop has the zero 0. A repeated pass can have several stretches
        that contain every stop without a doubt; the last of these stretches then has the zero 0.
        Stretches are joined by common stops. A stretch after an unwatched time is assumed to
        continue the count, with a doubt; a common stop that gives its offset, or a proof of an
        unbroken count, removes the doubt.
        """
        bases = dict.fromkeys(
            entry.stretch for _, entries in sorted(self.measured.items()) for entry in entries
        )
        found = [self._from(base) for base in bases]
        whole = [zeros for zeros in found if len(self._used(zeros)) == stops]
        fewest = min(
            (sum(bool(zero.doubt) for zero in self._used(zeros)) for zeros in whole),
            default=0,
        )
        best = [
            zeros
            for zeros in whole
            if sum(bool(zero.doubt) for zero in self._used(zeros)) == fewest
        ]
        if not best:
            return found[0] if found else {}
        return best[0] if fewest else best[-1]

    def _used(self, zeros: Zeros) -> list[Zero]:
        latest = [
            next((entry for entry in reversed(entries) if entry.stretch in zeros), None)
            for entries in self.measured.values()
        ]
        return [zeros[entry.stretch] for entry in latest if entry is not None]

    def _from(self, base: int) -> Zeros:
        zeros = {base: Zero(0.0)}
        while self._join(zeros) or self._presume(zeros):
            pass
        return zeros

    def _join(self, zeros: Zeros) -> bool:
        others = dict.fromkeys(
            entry.stretch
            for entries in self.measured.values()
            for entry in entries
            if entry.stretch not in zeros
        )
        for stretch in others:
            shifts = list(self._shifts(stretch, zeros))
            sure = [each for each in shifts if not each[1].doubt] or shifts
            if sure and self._agree(sure):
                zeros[stretch] = self._joined(stretch, sure)
                return True
        return False

    def _shifts(self, stretch: int, zeros: Zeros) -> Iterator[tuple[float, Zero, float]]:
        """Yield, for every stop measured in both ``stretch`` and a stretch with a known zero, the
        shift in mm between both stretches, the known zero, and the uncertainty of the shift.
        """
        for entries in self.measured.values():
            last = {
                entry.stretch: entry
                for entry in entries
                if entry.stop.reading_mm is not None and _of_one_count(entry.stop)
            }
            for known in [each for each in last if each in zeros] if stretch in last else ():
                here, there = last[stretch], last[known]
                shift_mm = zeros[known].offset_mm + there.beside_mm - here.beside_mm
                yield (
                    shift_mm,
                    _doubted(zeros[known], there.stop, here.stop),
                    float(np.hypot(here.stop.u_um, there.stop.u_um)),
                )

    def _agree(self, shifts: list[tuple[float, Zero, float]]) -> bool:
        """Return whether all stops measured in both stretches give the same shift; a moved mirror
        gives different shifts.
        """
        return _spread_um(shifts) <= 2.0 * self.same_um + SURE * max(
            u_um for _, _, u_um in shifts
        )

    def _joined(self, stretch: int, shifts: list[tuple[float, Zero, float]]) -> Zero:
        offset_mm, known = float(np.median([shift for shift, _, _ in shifts])), shifts[0][1]
        slip = self._slip_between(stretch, known)
        if slip is not None and len(shifts) == 1 and not known.doubt:
            why = message("read-otherwise", stop=slip.stop, size_um=slip.size_um)
            return Zero(offset_mm, why, "reading-differs", slip.size_um)
        return Zero(offset_mm, known.doubt, known.code, known.size_um)

    def _slip_between(self, stretch: int, known: Zero) -> Slip | None:
        return self.slips.get(stretch) or next(
            (
                slip
                for later, slip in self.slips.items()
                if stretch == later - 1 and not known.doubt
            ),
            None,
        )

    def _presume(self, zeros: Zeros) -> bool:
        """Assume that one further stretch continues the count of the stretch before it; return
        False without such a stretch.
        """
        for stretch, cut in self.unwatched.items():
            if stretch not in zeros and cut.before in zeros:
                known, doubt = zeros[cut.before], cut.doubt
                code = known.code or (cut.code if doubt else "")
                zeros[stretch] = Zero(
                    known.offset_mm, known.doubt or doubt, code, known.size_um
                )
                return True
        return False

    def misfit_um(self, zeros: Zeros) -> float | None:
        """Return the largest difference in um between the shifts of the stops that two stretches
        have in common, if this difference prevents joining the stretches; otherwise None.
        """
        apart = {
            entry.stretch for entries in self.measured.values() for entry in entries
        } - set(zeros)
        spreads = [
            _spread_um(shifts)
            for stretch in apart
            if len(shifts := list(self._shifts(stretch, zeros))) > 1
        ]
        return max(spreads, default=None)


def _doubted(known: Zero, *readings: CapturedStop) -> Zero:
    """Return the known zero of a stretch, with the doubts of the readings that join another stretch
    to this stretch.

    If two stretches have a single common stop, the error of its reading becomes the error of the
    whole joined stretch.
    """
    doubtful = next((each for each in readings if each.doubts), None)
    if known.doubt or doubtful is None:
        return known
    return Zero(known.offset_mm, doubtful.why(), doubtful.doubts[0].code)


def _of_one_count(stop: CapturedStop) -> bool:
    """Return whether a reading can be compared with other readings of the same stop. A reading from
    a window with a step may belong to the earlier count. A reading at a reversal has another
    direction of approach.
    """
    return "window-step" not in stop.doubt_codes and not stop.turned


def _spread_um(shifts: list[tuple[float, Zero, float]]) -> float:
    values = [shift for shift, _, _ in shifts]
    return (max(values) - min(values)) * 1e3
