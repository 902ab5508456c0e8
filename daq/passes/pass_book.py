"""All passes of a survey."""

import itertools
import math
from collections.abc import Iterable

from msgspec.structs import replace

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, Words, message
from stepdiag.base.readings.runs import first_count
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.capture.conditions import Credible
from stepdiag.daq.capture.log_start import CaptureStart, PassHint
from stepdiag.daq.capture.naming.route import Route, route_of, shared
from stepdiag.daq.capture.remarks.remarks import credible_of
from stepdiag.daq.capture.remarks.unchecked import places_known
from stepdiag.daq.passes.comparison import compare, may_hide_um
from stepdiag.daq.passes.counts import Numbered, went_on
from stepdiag.daq.passes.doubt import Acceptance, Doubt, TimeStated
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.stretches import same_um
from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.formats import repeats_after
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.stream import Break


class PassBook:
    """All passes of a survey, from captured stops in the order of capture."""

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self._planned = survey.planned
        self._stretch = 0
        self.last: CapturedStop | None = None
        self.preferred = ""
        """The next setup by the operator's choice; empty without a choice."""
        self.wrong_line = ""
        """The line of the survey file that is wrong according to a finding. Until the line is
        corrected, no pass has to be driven again.
        """
        self.driven: Pass | None = None
        self.passes: list[Pass] = []
        self.stops = 0
        """Number of captured stops, usable or not."""
        self.time_stated: TimeStated | None = None
        self._credible: dict[str, Credible] = {}
        self._numbered: dict[int, Numbered] = {}
        """The sample numbers of the instrument in each stretch of count."""
        self._repeats_after = repeats_after(survey)
        self._known: dict[int, float] = {}
        self._believed: tuple[float, ...] = ()
        self._placed = places_known(survey)
        self._same_um = same_um(assumptions_of(survey).repeatability_um)
        self._acceptances: list[Acceptance] = []
        self._suspected: tuple[Doubt, ...] = ()
        self._suspicions: list[tuple[int, tuple[Doubt, ...]]] = []
        self._news: list[Finding] = []

    @property
    def last_count(self) -> int | None:
        """Return the machine's stop count at the newest stop; None before the first stop, or if the
        machine does not count.
        """
        return None if self.last is None else self.last.stop_count

    def add_all(self, stops: Iterable[CapturedStop]) -> None:
        for stop in stops:
            self.add(stop)

    def add(self, stop: CapturedStop) -> Pass:
        """Add the next captured stop and return its pass."""
        while self._suspicions and self._suspicions[0][0] <= self.stops:
            self.suspect(self._suspicions.pop(0)[1])
        self._stretch += bool(stop.broken or stop.unwatched)
        self._numbered.setdefault(self._stretch, Numbered()).add(stop.count, stop.time_s)
        stretch, cut = self._stretch, self._left_open(stop)
        if cut is not None:
            self._put(stop, cut)
        current = self.driven = self._current(stop)
        if current is not cut:
            self._put(stop, current)
        self._know(stop, current, anew=bool(stop.broken) or self._stretch != stretch)
        self._compare(stop.setup)
        self._prove(stop.setup)
        self.stops += 1
        self._credible.update(credible_of(stop))
        self.last = stop
        return current

    def _left_open(self, stop: CapturedStop) -> Pass | None:
        """Return the last driven pass if it lacks readings and the stop is its first stop, too: the
        first stop of the next pass may join its stretches of count.
        """
        driven = self.driven
        if driven is None or stop.stop > 0 or driven.whole:
            return None
        way = driven.route.setup, driven.route.outward
        return driven if way == (stop.setup, stop.outward) else None

    def _put(self, stop: CapturedStop, current: Pass) -> None:
        """Add a stop to a pass. A reading that differs within one count begins a new stretch."""
        slip_um = current.differs_um(stop, self._stretch)
        if slip_um is not None:
            self._stretch += 1
            self._numbered[self._stretch] = Numbered()
            self._news.append(_slipped(current, stop, slip_um))
        current.add(stop, self._stretch, slip_um)

    def _know(self, stop: CapturedStop, current: Pass, *, anew: bool) -> None:
        """Store the readings of the unbroken count by stop, from which the capture of the next log
        identifies the stop of the machine.
        """
        if anew or self.last is None or self.last.setup != stop.setup:
            self._known = {}
        self._believed = () if anew or not _believed_only(stop) else self._believed
        if _believed_only(stop) and stop.reading_mm is not None:
            self._believed = (*self._believed, stop.reading_mm)
        if stop.reading_mm is not None and not stop.refused and not _believed_only(stop):
            self._known[stop.stop if stop.outward else len(current.route) - 1 - stop.stop] = (
                stop.reading_mm
            )

    def news(self) -> tuple[Finding, ...]:
        """Return the findings of the comparisons since the last call, for the journal."""
        news, self._news = tuple(self._news), []
        return news

    def doubts(self) -> tuple[Doubt, ...]:
        """Return the doubts about planned passes without an acceptance; each doubt keeps its pass
        open.
        """
        return tuple(
            doubt
            for each in self.passes
            if each.number in self.wanted()
            for doubt in each.open_doubts()
        )

    def suspect(self, doubts: Iterable[Doubt]) -> None:
        """Replace the doubts from other sources, such as the solver. A doubt applies while its
        measurement is used.
        """
        self._suspected = tuple(doubts)
        for each in self.passes:
            each.suspected = [
                doubt
                for doubt in self._suspected
                if (doubt.setup, doubt.pass_number) == (each.route.setup, each.number)
            ]

    def foretell(self, suspicions: Iterable[tuple[int, tuple[Doubt, ...]]]) -> None:
        """Set the suspicions that were raised during the capture of the next stops: for each
        suspicion, the number of stops before it, and its doubts.

        A stop that was driven because of a suspicion is assigned to the suspected pass, not to a
        further pass.
        """
        self._suspicions = list(suspicions)

    def accept(self, word: Acceptance) -> None:
        if word not in self._acceptances:
            self._acceptances.append(word)

    def accepted(self) -> tuple[tuple[Doubt, Acceptance], ...]:
        doubts = [doubt for each in self.passes for doubt in each.doubts()]
        pairs = (
            (doubt, next((word for word in self._acceptances if word.covers(doubt)), None))
            for doubt in doubts
        )
        return tuple((doubt, word) for doubt, word in pairs if word is not None)

    def last_stop(self, stop: CapturedStop) -> int:
        """Return the number of the last stop of a stop's pass (30 in ``stop 5 of 30``)."""
        return len(route_of(self._planned, stop.setup, 1)) - 1

    def deviation(self, stop: CapturedStop) -> tuple[float | None, float | None]:
        """Return the reading of a stop in mm and its deviation from the geometry in um, relative to
        the first stop of its pass.

        None without a reading, or if the count was lost since the first stop.
        """
        passes = [each for each in self.of(stop.setup) if each.route.outward == stop.outward]
        each = next((each for each in reversed(passes) if each.uses(stop)), None)
        if each is None or stop.reading_mm is None:
            return None, None
        chosen = each.chosen()
        first = chosen[min(chosen)]
        reading = chosen[stop.stop].reading_mm - first.reading_mm
        nominal = float(each.route.nominal_mm[stop.stop] - each.route.nominal_mm[first.stop])
        return round(reading, 6), round((reading - nominal) * 1e3, 3)

    def of(self, setup: str) -> list[Pass]:
        """Return the passes of a setup, ordered by number."""
        return [each for each in self.passes if each.route.setup == setup]

    def wanted(self) -> list[int]:
        """Return the numbers of the planned passes of every setup: odd numbers outward, even
        numbers back.
        """
        return list(
            range(
                1,
                2 * self._survey.plan.repeats + 1,
                1 if self._survey.plan.return_pass else 2,
            )
        )

    def open_passes(self, setup: str) -> list[int]:
        """Return the numbers of the planned passes of a setup that are incomplete or doubted."""
        done = {each.number for each in self.of(setup) if each.complete}
        return [number for number in self.wanted() if number not in done]

    def whole(self) -> bool:
        """Return whether every stop of the plan has a usable reading, doubted or not."""
        have = {(each.route.setup, each.number) for each in self.passes if each.whole}
        return all(
            (setup, number) in have
            for setup in self._survey.plan.all_setups
            for number in self.wanted()
        )

    def complete(self) -> bool:
        """Return whether every pass of the plan is complete and free of doubts."""
        return not self.next_setup()

    def next_setup(self) -> str:
        """Return the next setup; empty when all setups are complete. A begun setup comes before a
        setup without a pass.
        """
        first = [self.preferred, self.last.setup if self.last is not None else ""]
        for setup in first:
            if setup and self.open_passes(setup):
                return setup
        return next(
            (setup for setup in self._survey.plan.all_setups if self.open_passes(setup)), ""
        )

    def start(
        self,
        *,
        skip_open_dwell: bool,
        wall_offset_ns: int = 0,
        breaks: tuple[Break, ...] = (),
        beyond: bool | None = None,
        anew: bool = True,
    ) -> CaptureStart:
        """Return the state of the survey that the capture of a new log needs. ``anew``: whether the
        machine's program may have begun anew since the last log.
        """
        following = self.next_setup()
        names = self._survey.plan.all_setups
        ordered = (
            [following, *(name for name in names if name != following)]
            if following
            else list(names)
        )
        hints = {name: self._hint(name, anew=anew) for name in ordered}
        return CaptureStart(
            hints=hints,
            wall_offset_ns=wall_offset_ns,
            last_count=self.last_count,
            skip_open_dwell=skip_open_dwell,
            breaks=breaks,
            credible=dict(self._credible),
            beyond=beyond,
        )

    def _hint(self, setup: str, *, anew: bool) -> PassHint:
        hint, driven = self._standing(setup, anew=anew), self.driven
        out, back = self._next(setup, outward=True), self._next(setup, outward=False)
        if driven is not None and driven.route.setup == setup:
            if hint.next_stop and driven.route.outward:
                out = driven.number
            elif hint.next_stop:
                back = driven.number
            else:
                if driven.route.outward:  # a way back has the order of the way out before it
                    back = self._next(setup, driven.route.order, outward=False)
                if not anew:
                    order = route_of(self._planned, setup, self._next_out(driven)).order
                    out = self._next(setup, order, outward=True)
            known, before = hint.known, self._way_out(setup, driven.number)
            for number in (out, back):
                known = shared(known, before, self._way_out(setup, number))
            hint = replace(hint, known=known)
        others = self._others(setup, (out, back))
        return replace(hint, numbers=(out, back), others=others)

    def _next_out(self, driven: Pass) -> int:
        """Return the number of the next pass out in the program, after the driven pass: a pass that
        is driven again has another place in the program, which the counter shows.
        """
        setup, route = driven.route.setup, driven.route
        number = next(
            (
                each
                for each in self.wanted()
                if self.last is not None
                and self.last.stop_count is not None
                and first_count(self._planned, setup, each) + self.last.stop
                == self.last.stop_count
                and route_of(self._planned, setup, each).counts == route.counts
            ),
            driven.number,
        )
        return number + 1 + number % 2

    def _others(self, setup: str, numbers: tuple[int, int]) -> tuple[int, ...]:
        """Return the numbers of passes with other orders of the axes that may come instead of the
        next passes: an open pass, the first pass of a program that begins anew, and in the program
        the pass after a pass with the driven order.
        """
        orders = [route_of(self._planned, setup, number).order for number in numbers]
        may = [*self.open_passes(setup), 1]
        if self.driven is not None and self.driven.route.setup == setup:
            driven = self.driven.route.order
            may += [
                number + 2
                for number in self.wanted()
                if route_of(self._planned, setup, number).order == driven
            ]
        others: dict[tuple[bool, str], int] = {}
        for each in may:
            route = route_of(self._planned, setup, each)
            if route.order != orders[0 if route.outward else 1]:
                number = self._next(setup, route.order, outward=route.outward)
                others[route.outward, route.order] = number
        return tuple(others.values())

    def _way_out(self, setup: str, number: int) -> Route:
        return route_of(self._planned, setup, number - 1 + number % 2)

    def _next(self, setup: str, order: str = "", *, outward: bool) -> int:
        """Return the number of the pass to which a stop of a setup, driven in the given direction,
        would belong. ``order``: the order of the axes; empty for any.
        """
        found = self._find(setup, order, outward=outward)
        return (
            found.number
            if found is not None and not found.complete
            else self._after(setup, order, outward=outward)
        )

    def _standing(self, setup: str, *, anew: bool) -> PassHint:
        still_open = self.open_passes(setup)
        wanted, outward = bool(still_open), not still_open or still_open[0] % 2 == 1
        last = self.last
        if last is None or last.setup != setup:
            return PassHint(wanted=wanted, outward=outward)
        current, known = self.driven, dict(self._known)
        over, both_ways = last.stop == self.last_stop(last), self._survey.plan.return_pass
        if _believed_only(last):
            turned = over and both_ways and not anew
            return PassHint(
                wanted=wanted,
                outward=last.outward is not turned,
                believed=self._believed if over else (),
            )
        if current is not None and last.stop + 1 < len(current.route):
            following = last.stop + 1
            return PassHint(
                wanted=wanted,
                outward=last.outward,
                next_stop=following,
                last_reading_mm=last.reading_mm,
                known=known,
            )
        if last.outward and both_ways and (known or not anew):
            return PassHint(wanted=wanted, outward=False, turn=last, known=known)
        return PassHint(
            wanted=wanted, outward=outward, turn=None if last.outward else last, known=known
        )

    def _compare(self, setup: str) -> None:
        passes = self.of(setup)
        known = {doubt for each in passes for doubt in each.against}
        for each, doubts in compare(passes, alone=len(self.wanted()) == 1).items():
            passes[each].against = doubts
        new = dict.fromkeys(
            doubt for each in passes for doubt in each.against if doubt not in known
        )
        self._news += [_as_finding(doubt) for doubt in new]

    def _prove(self, setup: str) -> None:
        """Judge whether the count is unbroken over the unwatched times of a setup's passes: the
        sample number of the instrument must continue, and the other passes must exclude a lost
        count.

        The sample number alone proves that the instrument ran, but not that the beam was free.
        """
        passes = self.of(setup)
        for each in passes:
            for stretch, cut in each.cuts().items():
                ran = went_on(
                    self._numbered[cut.before], self._numbered[stretch], self._repeats_after
                )
                hidden_um = may_hide_um(each, cut.stop, passes) if ran else math.inf
                proven = bool(hidden_um <= self._same_um)
                if proven and not cut.proven:
                    held = message(
                        "laser-unwatched.held",
                        stop=cut.stop,
                        why=cut.why,
                        hidden_um=hidden_um,
                    )
                    place = each.doubted(each.chosen()[cut.stop], held.code, held).at
                    self._news.append(finding("info", held, place))
                each.judge(
                    cut,
                    proven=proven,
                    unproven="" if proven else _unproven(ran, hidden_um, self._same_um),
                )

    def _current(self, stop: CapturedStop) -> Pass:
        last = self.last
        if (
            last is not None
            and (last.setup, last.outward) == (stop.setup, stop.outward)
            and stop.stop >= last.stop
            and self.driven
            and stop.order in ("", self.driven.route.order)
        ):
            return self.driven
        found = self._find(stop.setup, stop.order, outward=stop.outward)
        if found is not None and not found.complete:
            return found
        number = self._after(stop.setup, stop.order, outward=stop.outward)
        fresh = Pass(
            route_of(self._planned, stop.setup, number),
            number,
            self._placed,
            self._acceptances,
            same_um=self._same_um,
        )
        self.passes.append(fresh)
        return fresh

    def _find(self, setup: str, order: str = "", *, outward: bool) -> Pass | None:
        """Return the first incomplete pass of a setup in a direction, else the last one; None
        without a pass. ``order``: the order of its axes; empty for any.
        """
        same = [
            each
            for each in self.of(setup)
            if each.route.outward == outward and order in ("", each.route.order)
        ]
        return next((each for each in same if not each.complete), same[-1] if same else None)

    def number_of(self, route: Route) -> int:
        driven = self.driven
        if (
            driven is not None
            and (driven.route.setup, driven.route.outward, driven.route.order)
            == (route.setup, route.outward, route.order)
            and not driven.complete
        ):
            return driven.number
        return self._next(route.setup, route.order, outward=route.outward)

    def _after(self, setup: str, order: str = "", *, outward: bool) -> int:
        """Return the number of a new pass: odd outward, even back. Without return passes, the
        numbers are 1, 3, 5. ``order``: the order of its axes; empty for any.
        """
        taken = {each.number for each in self.of(setup)}
        return next(
            number
            for number in itertools.count(1 if outward else 2, 2)
            if number not in taken
            and order in ("", route_of(self._planned, setup, number).order)
        )


def _believed_only(stop: CapturedStop) -> bool:
    """Return whether the place of a stop is only assumed, and must not identify another stop."""
    return "place-unknown" in stop.doubt_codes


def _unproven(ran: bool | None, hidden_um: float, most_um: float) -> Words:
    if ran is None:
        return ""
    if not ran:
        return message("number-does-not-fit")
    if math.isinf(hidden_um):
        return message("beam-unchecked")
    return message("beam-unsure", hidden_um=hidden_um, most_um=most_um)


def _slipped(each: Pass, stop: CapturedStop, slip_um: float) -> Finding:
    why = message("reading-differs", size_um=slip_um)
    return _as_finding(each.doubted(stop, why.code, why, round(slip_um, 3)))


def _as_finding(doubt: Doubt) -> Finding:
    why = (
        doubt.why
        if isinstance(doubt.why, Message)
        else message("as-it-stands", text=doubt.why)
    )
    return finding("warning", why, doubt.at, code=doubt.code, size_um=doubt.size_um)
