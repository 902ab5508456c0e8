"""From captured stops to passes: which are whole, which must be driven again, and why."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.route import Route, make_route
from stepdiag.daq.capture.stop import CapturedStop
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import Break


@dataclass(frozen=True, slots=True)
class Measured:
    """A stop and the stretch of unbroken count it belongs to."""

    stop: CapturedStop
    stretch: int


@dataclass(frozen=True, slots=True)
class Zero:
    """What to add to the readings of a stretch, in mm, so that it shares the zero of the pass; ``doubt`` says why it may not be right."""

    offset_mm: float
    doubt: str = ""


@dataclass(slots=True)
class Pass:
    """One pass as far as it has been driven. A stop measured again replaces the earlier one where their zeros are known to be the same."""

    route: Route
    number: int
    measured: dict[int, list[Measured]] = field(default_factory=dict)
    _unwatched: dict[int, tuple[int, str]] = field(default_factory=dict)
    """Of a stretch before which nobody watched the laser: the stretch before it, and why."""
    _stretch: int | None = None
    _zeros: dict[int, Zero] | None = None

    def add(self, stop: CapturedStop, stretch: int) -> None:
        """Take a stop, unless it was refused."""
        self._zeros = None
        if stop.unwatched and not stop.broken and self._stretch is not None:
            self._unwatched[stretch] = self._stretch, f"{stop.unwatched} before stop {stop.stop}"
        self._stretch = stretch
        if not stop.refused:
            self.measured.setdefault(stop.stop, []).append(Measured(stop, stretch))

    def zeros(self) -> dict[int, Zero]:
        """Return the zero of every stretch that has one.

        Stretches are joined by stops that were measured in both. One before which nobody watched the laser is taken to have kept its count,
        and doubted, unless such a stop says how it is. A stretch after a loss of count that cannot be joined is absent.
        """
        if self._zeros is None:
            self._zeros = {self.measured[min(self.measured)][0].stretch: Zero(0.0)} if self.measured else {}
            while self._join(self._zeros) or self._presume(self._zeros):
                pass
        return self._zeros

    def _join(self, zeros: dict[int, Zero]) -> bool:
        """Join one more stretch to those whose zero is known; return whether there was one."""
        for readings in map(_readings, self.measured.values()):
            known = next((stretch for stretch in readings if stretch in zeros), None)
            for stretch in readings if known is not None else ():
                if stretch not in zeros and known is not None:
                    zeros[stretch] = Zero(zeros[known].offset_mm + readings[known] - readings[stretch], zeros[known].doubt)
                    return True
        return False

    def _presume(self, zeros: dict[int, Zero]) -> bool:
        """Take one more stretch to have kept the count of the one before it; return whether there was one."""
        for stretch, (before, why) in self._unwatched.items():
            if stretch not in zeros and before in zeros:
                zeros[stretch] = Zero(zeros[before].offset_mm, zeros[before].doubt or why)
                return True
        return False

    def doubt(self, index: int) -> str:
        """Return why the count at a stop may be off; empty where it is not doubted."""
        entries = [zeros.doubt for entry in self.measured.get(index, ()) if (zeros := self.zeros().get(entry.stretch)) is not None]
        return entries[-1] if entries else ""

    def why_doubtful(self) -> str:
        """Return in words which stops may be off, why, and how to make sure; empty where none is doubted."""
        doubted = [index for index in sorted(self.measured) if self.doubt(index)]
        if not doubted:
            return ""
        again = max(doubted[0] - 1, 0)
        return f"stops {_listed(doubted)} may be off ({self.doubt(doubted[0])}): to make sure, drive again from stop {again} on"

    def chosen(self) -> dict[int, tuple[CapturedStop, float]]:
        """Return the latest usable measurement of every stop with its offset in mm, by stop number."""
        zeros = self.zeros()
        usable = {index: [entry for entry in entries if entry.stretch in zeros] for index, entries in sorted(self.measured.items())}
        return {index: (entries[-1].stop, zeros[entries[-1].stretch].offset_mm) for index, entries in usable.items() if entries}

    @property
    def missing(self) -> list[int]:
        """Return the stops without a usable reading."""
        have = self.chosen()
        return [index for index in range(len(self.route)) if index not in have]

    @property
    def complete(self) -> bool:
        """Tell whether every stop has a usable reading."""
        return not self.missing

    def why_incomplete(self) -> str:
        """Return in words what is missing and what to do about it; empty for a whole pass."""
        missing = self.missing
        if not missing:
            return ""
        listed = _listed(missing)
        again = f"drive again from stop {max(missing[0] - 1, 0)} on, or the whole pass"
        lost = [index for index in missing if index in self.measured]
        if lost:
            reasons = [entry.stop.broken for index in lost for entry in self.measured[index] if entry.stop.broken]
            why = reasons[0] if reasons else "the count was lost"
            return f"stops {listed} do not reach back to the start ({why}): {again}"
        return f"stops {listed} are missing: {again}"


def _listed(stops: Sequence[int]) -> str:
    return ", ".join(str(index) for index in stops[:6]) + (" .." if len(stops) > 6 else "")


def _readings(entries: list[Measured]) -> dict[int, float]:
    """Return the last reading of each stretch at one stop."""
    return {entry.stretch: entry.stop.reading_mm for entry in entries if entry.stop.reading_mm is not None}


class PassBook:
    """All passes of a survey, built from captured stops in the order in which they were captured."""

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self._stretch = 0
        self._last: CapturedStop | None = None
        self.preferred = ""
        """The setup that a person wants next."""
        self.driven: Pass | None = None
        self.passes: list[Pass] = []
        self.last_count: int | None = None

    def add_all(self, stops: Iterable[CapturedStop]) -> None:
        """Take stops in the order of their capture."""
        for stop in stops:
            self.add(stop)

    def add(self, stop: CapturedStop) -> Pass:
        """Take the next stop; return the pass it belongs to."""
        self._stretch += bool(stop.broken or stop.unwatched)
        current = self.driven = self._current(stop)
        current.add(stop, self._stretch)
        self.last_count = stop.stop_count
        self._last = stop
        return current

    def of(self, setup: str) -> list[Pass]:
        """Return the passes of a setup in order."""
        return [each for each in self.passes if each.route.setup == setup]

    def wanted(self) -> list[int]:
        """Return the numbers of the passes that the plan wants of every setup: odd outward, even back."""
        return list(range(1, 2 * self._survey.plan.repeats + 1, 1 if self._survey.plan.return_pass else 2))

    def open_passes(self, setup: str) -> list[int]:
        """Return the numbers of the wanted passes of a setup that are not whole."""
        whole = {each.number for each in self.of(setup) if each.complete}
        return [number for number in self.wanted() if number not in whole]

    def complete(self) -> bool:
        """Tell whether every pass of the plan is in."""
        return not self.next_setup()

    def next_setup(self) -> str:
        """Return the setup that comes next; empty when all are in. A setup begun comes before one not begun."""
        first = [self.preferred, self._last.setup if self._last is not None else ""]
        for setup in first:
            if setup and self.open_passes(setup):
                return setup
        return next((setup for setup in self._survey.plan.all_setups if self.open_passes(setup)), "")

    def start(self, *, skip_open_dwell: bool, wall_offset_ns: int = 0, breaks: tuple[Break, ...] = ()) -> CaptureStart:
        """Return what a new log's capture needs to know."""
        following = self.next_setup()
        names = self._survey.plan.all_setups
        ordered = [following, *(name for name in names if name != following)] if following else list(names)
        hints = {name: self._hint(name) for name in ordered}
        return CaptureStart(
            hints=hints, wall_offset_ns=wall_offset_ns, last_count=self.last_count, skip_open_dwell=skip_open_dwell, breaks=breaks
        )

    def _hint(self, setup: str) -> PassHint:
        still_open = self.open_passes(setup)
        wanted, outward = bool(still_open), not still_open or still_open[0] % 2 == 1
        last = self._last
        if last is None or last.setup != setup:
            return PassHint(wanted=wanted, outward=outward)
        current = self._find(setup, outward=last.outward)
        if current is not None and last.stop + 1 < len(current.route):
            return PassHint(wanted=wanted, outward=last.outward, next_stop=last.stop + 1, last_reading_mm=last.reading_mm)
        if last.outward and self._survey.plan.return_pass:
            return PassHint(wanted=wanted, outward=False, turn=last)
        return PassHint(wanted=wanted, outward=outward)

    def _current(self, stop: CapturedStop) -> Pass:
        last = self._last
        if last is not None and (last.setup, last.outward) == (stop.setup, stop.outward) and stop.stop >= last.stop and self.driven:
            return self.driven
        found = self._find(stop.setup, outward=stop.outward)
        if found is not None and not found.complete:
            return found
        route = make_route(self._survey.volume, stop.setup, self._survey.axis_order, outward=stop.outward)
        fresh = Pass(route, self._number(stop))
        self.passes.append(fresh)
        return fresh

    def _find(self, setup: str, *, outward: bool) -> Pass | None:
        same = [each for each in self.of(setup) if each.route.outward == outward]
        return next((each for each in same if not each.complete), same[-1] if same else None)

    def _number(self, stop: CapturedStop) -> int:
        """Return the number of a new pass: odd outward, even back; without return passes 1, 3, 5."""
        same = sum(1 for each in self.of(stop.setup) if each.route.outward == stop.outward)
        return 2 * same + (1 if stop.outward else 2)
