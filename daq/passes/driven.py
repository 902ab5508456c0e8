"""The state of a pass while it is driven: its stops with a usable reading, its doubtful stops, and
the remedies.
"""

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field

from stepdiag.base.messages import Message, Way, Words, message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.naming.route import Route
from stepdiag.daq.passes.doubt import Acceptance, Doubt
from stepdiag.daq.passes.stretches import (
    SAME_UM,
    Measured,
    OnZero,
    Slip,
    Stretches,
    Unwatched,
    Zero,
    Zeros,
    on_zero,
)

Chosen = dict[int, OnZero]


@dataclass(slots=True)
class Pass:
    """The state of a pass. A repeated measurement of a stop replaces the earlier measurement if
    both have a known common zero.

    ``placed`` means that the machine sends its position. Without a position the operator can
    continue from a stop only while the laser's count is unbroken. ``acceptances`` is the list of
    acceptances in the `PassBook`; ``against`` are the doubts from other passes of the setup.
    """

    route: Route
    number: int
    placed: bool = True
    acceptances: list[Acceptance] = field(default_factory=list)
    against: tuple[Doubt, ...] = ()
    suspected: list[Doubt] = field(default_factory=list)
    """Doubts about readings of this pass from other sources, such as the solver."""
    same_um: InitVar[float] = SAME_UM
    """Largest difference in um between two measurements of a stop."""
    _stretches: Stretches = field(default_factory=Stretches)
    _stretch: int | None = None
    _last: int = -1
    _visit: int = 0
    _zeros: Zeros | None = None
    _chosen: Chosen | None = None
    _shown: Chosen = field(default_factory=dict)
    _used: dict[int, tuple[Measured, float]] = field(default_factory=dict)
    """The valid measurement of every stop, and the offset in mm of its zero."""

    def __post_init__(self, same_um: float) -> None:
        self._stretches.same_um = same_um

    @property
    def measured(self) -> dict[int, list[Measured]]:
        """Return all measurements of each stop, in the order of capture."""
        return self._stretches.measured

    @property
    def way(self) -> Way:
        return self.route.way

    @property
    def run(self) -> Message:
        return self.route.run

    @property
    def place(self) -> str:
        """Return the name of the pass, such as ``ppp/1``."""
        return f"{self.route.setup}/{self.number}"

    def differs_um(self, stop: CapturedStop, stretch: int) -> float | None:
        """Return the increase in um of a stop's reading since its earlier reading in the same
        unbroken count; None if the two readings agree or there is no earlier reading.
        """
        return (
            None
            if stop.refused
            else self._stretches.differs_um(self._measured(stop, stretch))
        )

    def add(self, stop: CapturedStop, stretch: int, slip_um: float | None = None) -> None:
        """Add the measurement of a stop; a refused reading is ignored. ``slip_um`` is the
        difference to the earlier reading if a new stretch begins with this stop.
        """
        self._zeros = self._chosen = None
        if stop.unwatched and not stop.broken and self._stretch is not None:
            code = "window-step" if "window-step" in stop.doubt_codes else "laser-unwatched"
            self._stretches.unwatched[stretch] = Unwatched(
                self._stretch, stop.stop, stop.unwatched, code
            )
        if slip_um is not None:
            self._stretches.slips[stretch] = Slip(stop.stop, slip_um)
        self._stretch = stretch
        self._visit += stop.stop != self._last
        self._last = stop.stop
        if not stop.refused:
            self.measured.setdefault(stop.stop, []).append(self._measured(stop, stretch))

    def _measured(self, stop: CapturedStop, stretch: int) -> Measured:
        return Measured(
            stop, stretch, self._visit, self.route.nominal_at_mm(stop.position_mm)
        )

    def zeros(self) -> Zeros:
        if self._zeros is None:
            self._zeros = self._stretches.zeros(len(self.route))
        return self._zeros

    def chosen(self) -> Chosen:
        """Return the valid measurement of every stop by number, with its reading on the zero of the
        pass.

        The latest usable measurement is valid. Of several measurements during one standstill, the
        undoubted measurement with the most samples is valid.
        """
        if self._chosen is None:
            zeros, before = self.zeros(), self._used
            self._used = {
                index: (each, zeros[each.stretch].offset_mm)
                for index, entries in sorted(self.measured.items())
                if (each := self._best(entries)) is not None
            }
            # a new stop does not change the other stops of its pass, and computing these
            # stops again would delay the machine
            self._chosen = self._shown = {
                index: self._shown[index]
                if before.get(index) == used
                else on_zero(used[0].stop, used[1])
                for index, used in self._used.items()
            }
        return self._chosen

    def uses(self, stop: CapturedStop) -> bool:
        return stop.stop in self.chosen() and self._used[stop.stop][0].stop is stop

    def _best(self, entries: list[Measured]) -> Measured | None:
        usable = [entry for entry in entries if entry.stretch in self.zeros()]
        visit = [entry for entry in usable if entry.visit == usable[-1].visit]
        ranked = [
            (not entry.stop.doubts, entry.stop.samples, order)
            for order, entry in enumerate(visit)
        ]
        return visit[max(ranked)[2]] if visit else None

    @property
    def base(self) -> int | None:
        """Return the stretch that defines the zero of `chosen`; None before the first stop of the
        pass. If this stretch changes, the readings of `chosen` have another zero.
        """
        return next(iter(self.zeros()), None)

    @property
    def missing(self) -> list[int]:
        """Return the stops without a usable reading."""
        have = self.chosen()
        return [index for index in range(len(self.route)) if index not in have]

    @property
    def whole(self) -> bool:
        """Return whether every stop has a usable reading."""
        return not self.missing

    @property
    def complete(self) -> bool:
        """Return whether the pass is whole, and every doubt is accepted."""
        return self.whole and not self.open_doubts()

    def doubts(self) -> tuple[Doubt, ...]:
        """Return the doubts about the used readings, accepted or not, in the order of the stops."""
        of_stops = [
            self.doubted(stop, code, stop.why(code))
            for stop in self.chosen().values()
            for code in stop.doubt_codes
        ]
        of_zeros: dict[Words, Doubt] = {}
        for stop in self.chosen().values():
            zero = self._zero_at(stop.stop)
            if zero is not None and zero.doubt and zero.doubt not in of_zeros:
                of_zeros[zero.doubt] = self.doubted(
                    stop, zero.code, message("from-this-stop", why=zero.doubt), zero.size_um
                )
        known = {(each.stop, each.code) for each in of_stops}
        of_stops += [
            each for each in of_zeros.values() if (each.stop, each.code) not in known
        ]
        taken_ns = {index: stop.window_from_ns for index, stop in self.chosen().items()}
        newest_ns = max(taken_ns.values(), default=0)
        held = [
            each
            for each in self.suspected
            if each.taken_ns == (newest_ns if each.stop is None else taken_ns.get(each.stop))
        ]
        return (*sorted(of_stops, key=lambda each: each.stop or 0), *self.against, *held)

    def open_doubts(self) -> tuple[Doubt, ...]:
        return tuple(
            each
            for each in self.doubts()
            if not any(word.covers(each) for word in self.acceptances)
        )

    def doubted(
        self, stop: CapturedStop, code: str, why: Words, size_um: float | None = None
    ) -> Doubt:
        return Doubt(
            setup=self.route.setup,
            pass_number=self.number,
            stop=stop.stop,
            code=code,
            why=why,
            taken_ns=stop.window_from_ns,
            size_um=size_um,
            way=self.way,
            last=len(self.route) - 1,
        )

    def stretch_at(self, index: int) -> int | None:
        """Return the stretch of count of the used measurement at a stop; None without a
        measurement.
        """
        return self._used[index][0].stretch if index in self.chosen() else None

    def cuts(self) -> dict[int, Unwatched]:
        """Return the unwatched times between two successive used readings. The key is the stretch
        after the unwatched time.
        """
        return {
            stretch: cut
            for stretch, cut in self._stretches.unwatched.items()
            if cut.code == "laser-unwatched"
            and cut.before == stretch - 1
            and (self.stretch_at(cut.stop - 1), self.stretch_at(cut.stop))
            == (cut.before, stretch)
        }

    def judge(self, cut: Unwatched, *, proven: bool, unproven: Words = "") -> None:
        """Record whether the count is proven to be unbroken over an unwatched time; ``unproven`` is
        the reason for a missing proof.
        """
        if (proven, unproven) != (cut.proven, cut.unproven):
            cut.proven, cut.unproven = proven, unproven
            self._zeros = self._chosen = None

    def _zero_at(self, index: int) -> Zero | None:
        return (
            self.zeros().get(self._used[index][0].stretch) if index in self.chosen() else None
        )

    def doubt(self, index: int) -> Words:
        """Return the reason to doubt the used reading at a stop; empty without a doubt."""
        if index not in self.chosen():
            return ""
        stop = self.chosen()[index]
        zero = self._zero_at(index)
        against = next(
            (
                each.words
                for each in self.against
                if each.stop in (None, index) or index >= (each.stop or 0)
            ),
            "",
        )
        return stop.why() or (zero.doubt if zero is not None else "") or against

    @property
    def is_driven(self) -> bool:
        """Return whether driving again is useless: no stop is missing, and only an entered value
        can remove the open doubts.
        """
        return not self.missing and all(each.is_stated for each in self.open_doubts())

    def why_doubtful(self) -> Words:
        """Return a message with the doubted stops, the reasons, and the remedy; empty without an
        open doubt.
        """
        still = self.open_doubts()
        if not still:
            return ""
        if still[0] in (*self.against, *self.suspected):
            words = still[0].words
            return (
                message("or-accept", why=words)
                if still[0].names_the_cure
                else message("again-or-accept", why=words)
            )
        doubted = self._doubted(still)
        stops, why = doubted, self.doubt(doubted[0])
        if self.is_driven:
            return message("or-accept", why=message("stops-why", stops=stops, why=why))
        if not self._may_go_on():
            return message("stops-off-whole", stops=stops, why=why)
        return message("stops-off", stops=stops, why=why, stop=self.again_from())

    def why_incomplete(self) -> Words:
        """Return a message with the missing or doubted stops and the remedy; empty for a complete
        pass.
        """
        missing = self.missing
        if not missing:
            return self.why_doubtful()
        again = (
            message("again-from-or-whole", stop=self.again_from())
            if self._may_go_on()
            else message("whole-pass-again")
        )
        if (misfit_um := self._stretches.misfit_um(self.zeros())) is not None:
            return message("stops-misfit", stops=missing, misfit_um=misfit_um)
        lost = [index for index in missing if index in self.measured]
        if lost:
            reasons = [
                entry.stop.broken
                for index in lost
                for entry in self.measured[index]
                if entry.stop.broken
            ]
            why = reasons[0] if reasons else message("count-was-lost")
            return message("stops-without-start", stops=missing, why=why, again=again)
        return message("stops-missing", stops=missing, again=again)

    def again_from(self) -> int:
        """Return the number of the first stop to drive again; 0 means the whole pass."""
        missing, still = self.missing, self.open_doubts()
        if not self._may_go_on() or (
            not missing and (not still or still[0] in (*self.against, *self.suspected))
        ):
            return 0
        if missing:
            return (
                0
                if self._stretches.misfit_um(self.zeros()) is not None
                else max(missing[0] - 1, 0)
            )
        return max(
            self._doubted(still)[0] - (2 if still[0].code == "reading-differs" else 1), 0
        )

    def _doubted(self, still: Sequence[Doubt]) -> list[int]:
        named = {each.stop for each in still}
        return [
            index
            for index in sorted(self.chosen())
            if self.doubt(index) and (index in named or not self.chosen()[index].doubts)
        ]

    def _may_go_on(self) -> bool:
        """Return whether the machine may continue in the middle of the pass: the machine's
        position, or the unbroken count of the laser, identifies the stop.
        """
        return (
            self.placed
            or len({entry.stretch for entries in self.measured.values() for entry in entries})
            <= 1
        )
