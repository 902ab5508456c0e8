"""Search for the best survey within a time limit, by exchange: each step adds a beam line, removes
a line, or replaces a line by another line (Fedorov 1972, Cook and Nachtsheim 1980).

The information of a survey is the sum over its lines (`solver.planning.information`), so the search
chooses lines only. C is the covariance of the unknowns without a line; ``B B'`` is the information
of this line. With H of that module, the line reduces the mean square error over the volume, ``tr(C
H)``, by

    tr((1 + B' C B)^-1 B' C H C B)                 (1 - B' C B for its removal)

This reduction is computed for all possible lines at once. The first line of a setup takes the
set-up time; each further line of the same travel takes the time of a beam shift. The user states
these times. For the chosen lines, the search then chooses the number of passes, the orders of axes,
the number of increments and the dwell, and continues the exchange. Lines are compared with few
increments (`COARSE`), because the ranking of lines does not depend on the number of increments.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.names import AXES, BODY_DIAGONALS, FOURDOF_RUNS, LINEAR_RUNS
from stepdiag.base.readings.runs import (
    Plan,
    Run,
    perfect_readings,
    run_minutes,
    setup_minutes,
)
from stepdiag.base.setups import DRIVEN_SETUPS, FACE_DIAGONALS, setup_of
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.linear.families import hidden_factors
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.foresight import Foresight, bent_um
from stepdiag.solver.planning.information import inverse

COARSE, MIDDLE = 6, 10
INCREMENTS = range(8, 21)
"""Possible numbers of increments: with fewer increments the error between targets is too large,
and more increments have no gain."""
ORDERS = ("xyz", "yzx", "zxy")
"""Orders of axes that setups and repetitions use in turn: a change of order costs no time and
gives more information about angles (theory 5.2)."""
LEAST_MISSED = 6
"""Number of the least useful lines whose removal is computed in each exchange."""
LEAST_GAIN = 3e-3
"""Smallest gain of an exchange, as a share of the mean square error."""
TOGETHER = 8
"""Number of lines whose random effects are computed in one matrix; more lines would need more
memory."""
KEPT = 2
"""Number of choices of lines whose covariance is kept in memory for the next exchange."""
_NOTHING = 1e-10
_TOLD = 1e-3
"""Precision (1 / um^2) below which the information of a line is neglected, equal to an uncertainty
of 30 um."""


@dataclass(frozen=True, kw_only=True)
class Ways:
    """The passes of all lines of a survey: repetitions, directions, orders of axes and dwell."""

    repeats: int
    return_pass: bool
    axis_orders: tuple[str, ...]
    alternate: bool
    dwell_s: float

    @property
    def passes(self) -> int:
        """Return the number of passes of each setup."""
        return self.repeats * (1 + self.return_pass)

    def of(self, run: Run) -> Run:
        """Return a run with these repetitions, directions and orders of axes."""
        orders = self.axis_orders if setup_of(run.setup).kind in ("step", "face") else ()
        return replace(
            run,
            repeats=self.repeats,
            return_pass=self.return_pass,
            axis_orders=orders,
            alternate=self.alternate and bool(orders),
        )


def every_way(dwell_s: float, about: Circumstances) -> list[Ways]:
    """Return the possible kinds of passes, the simplest first: one pass in one direction with
    the planned dwell."""
    return [
        Ways(
            repeats=repeats,
            return_pass=back,
            axis_orders=ORDERS,
            alternate=True,
            dwell_s=dwell,
        )
        for dwell in dict.fromkeys((dwell_s, *about.dwells_s))
        for repeats, back in (
            (1, False),
            (1, True),
            (2, False),
            (3, False),
            (2, True),
            (3, True),
        )
    ]


def offered(survey: Plan, about: Circumstances) -> tuple[Run, ...]:
    """Return every possible line as a run of one pass: body diagonals, also with a shifted beam;
    face diagonals at the low end, the middle and the high end of the standing axis; runs along
    all four edges; and the lines of an available head."""
    size = np.array(survey.volume.size_mm)
    lines: list[tuple[str, tuple[float, float, float]]] = []
    for name in BODY_DIAGONALS:
        lines += [(name, shift) for shift in ((0.0, 0.0, 0.0), *_shifts(about))]
    for name in FACE_DIAGONALS:
        stands = np.array(setup_of(name).signs) == 0
        lines += [(name, _triple(share * size * stands)) for share in (0.0, 0.5, 1.0)]
    for name in LINEAR_RUNS:
        first, second = np.eye(3)[np.array(setup_of(name).signs) == 0] * size
        lines += [
            (name, _triple(a * first + b * second)) for a in (0.0, 1.0) for b in (0.0, 1.0)
        ]
    lines += [
        (name, (0.0, 0.0, 0.0))
        for name in FOURDOF_RUNS
        if about.head and any(turn[2] == name[-1].upper() for turn in about.head_turns)
    ]
    targets = max((run.targets for run in survey.runs), default=0)
    runs = [
        Run(setup=name, return_pass=False, beam_offset_mm=offset, targets=targets)
        for name, offset in lines
    ]
    return tuple(dict.fromkeys(run for run in runs if _travels(survey.volume, run)))


def _travels(volume: Volume, run: Run) -> bool:
    return all(
        has or not sign for has, sign in zip(volume.travelled, run.travel.signs, strict=True)
    )


def _shifts(about: Circumstances) -> Iterator[tuple[float, float, float]]:
    for size_mm in dict.fromkeys((about.shift_mm / 3.0, about.shift_mm)):
        for axis in range(len(AXES)):
            yield _triple(size_mm * np.eye(3)[axis])


def _triple(values: Vector) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) for value in values)
    return x, y, z


def survey_of(survey: Plan, lines: Sequence[Run], ways: Ways, increments: int) -> Plan:
    """Return the plan of a survey along some lines, sorted by travel. The names of setups on
    shifted lines have numbers."""
    runs: list[Run] = []
    number: dict[str, int] = {}
    usual = {run.travel.base for run in lines if not any(run.beam_offset_mm)}

    def place(run: Run) -> tuple[bool, int, tuple[float, float, float]]:
        # a survey file lists the setups on their usual lines before the setups on shifted
        # lines
        base = run.travel.base
        return base not in usual, DRIVEN_SETUPS.index(base), run.beam_offset_mm

    for run in sorted(lines, key=place):
        base = run.travel.base
        number[base] = number.get(base, 0) + any(run.beam_offset_mm)
        runs.append(
            ways.of(
                replace(
                    run,
                    setup=setup_of(base).shifted(
                        number[base] if any(run.beam_offset_mm) else 0
                    ),
                )
            )
        )
    pace = replace(survey.pace, dwell_s=ways.dwell_s)
    return replace(
        survey,
        runs=tuple(runs),
        volume=replace(survey.volume, increments=increments),
        pace=pace,
    )


@dataclass(frozen=True, slots=True)
class _Through:
    """Products of each line's factors B with the covariance C after a choice of lines: ``inner``
    B'CB, ``shown`` B'Ch, ``across`` B'C, shapes (lines, r, ..); and the mean square error over
    the volume after the choice."""

    square_um2: float
    inner: Vector
    shown: Vector
    across: Vector

    def without(self, line: int, factors: Vector) -> "_Through":
        """Return the products after one of the lines is removed from the choice; ``across`` is
        not updated."""
        count, rank, size = self.across.shape
        lost = np.linalg.inv(np.eye(rank) - self.inner[line])
        cross = (self.across.reshape(-1, size) @ factors[line].T).reshape(count, rank, rank)
        share = cross @ lost
        return _Through(
            square_um2=self.square_um2
            + float(np.sum((lost @ self.shown[line]) * self.shown[line])),
            inner=self.inner + share @ np.swapaxes(cross, 1, 2),
            shown=self.shown + share @ self.shown[line],
            across=self.across,
        )

    def changed(self, sign: float) -> Vector:
        """Return the mean square error after each line is added to the choice (``sign`` +1) or
        removed from it (-1), shape (lines,)."""
        inner = np.eye(self.inner.shape[1]) + sign * self.inner
        outer = self.shown @ np.swapaxes(self.shown, 1, 2)
        gain = np.trace(np.linalg.solve(inner, outer), axis1=1, axis2=2)
        found: Vector = self.square_um2 - sign * gain
        return found


class Exchange:
    """The search among possible lines, by the information of each line. All lines have the passes
    ``ways``.

    ``done`` are runs that were already driven; the last of these is still set up. Lines are
    compared with ``weighed_on`` increments.
    """

    def __init__(
        self,
        survey: Plan,
        about: Circumstances,
        lines: Sequence[Run],
        ways: Ways,
        done: Sequence[Run] = (),
        weighed_on: int = COARSE,
    ) -> None:
        self._survey = replace(
            survey, runs=(), pace=replace(survey.pace, dwell_s=ways.dwell_s)
        )
        self._about, self._ways = about, ways
        self.lines = tuple(lines)
        self._coarse = replace(survey.volume, increments=weighed_on)
        self._driven = [
            replace(run, setup=f"{run.travel.base}+{place + 1}", targets=0)
            for place, run in enumerate((*map(ways.of, lines), *done))
        ]
        self._information: dict[int, Vector] = {}
        before = range(len(lines), len(self._driven))
        heads = {place for place, run in enumerate(self._driven) if run.is_fourdof}
        first = next(place for place in range(len(self._driven)) if place not in heads)
        self._ahead = self._laid_out([first])
        measured = [run for run in done if run.is_fourdof]
        known_before = _known_angles(self._ahead, about, measured)
        for place in heads.difference(before):
            more = _known_angles(self._ahead, about, [*measured, lines[place]]) - known_before
            self._information[place] = np.diag(more)
        known = self._each(place for place in before if place not in heads)
        self._usual = (
            self._ahead.of.precision() + np.sum(known, axis=0) + np.diag(known_before)
        )
        self._seen = self._ahead.of.seen
        self._base = np.array([DRIVEN_SETUPS.index(run.travel.base) for run in lines])
        stands = replace(self._survey, runs=tuple(done[-1:]))
        self._setting_min = np.array([setup_minutes(stands, run) for run in lines])
        self._driving_min: dict[int, Vector] = {}
        self._square_um2: dict[frozenset[int], float] = {}
        self._added_um2: dict[frozenset[int], Vector] = {}
        self._covariance = lru_cache(KEPT)(self._inverted)
        self._through = lru_cache(KEPT)(self._seen_through)

    def _laid_out(self, places: Sequence[int]) -> Foresight:
        layout = lay_out(
            perfect_readings(
                Plan(
                    volume=self._coarse, runs=tuple(self._driven[place] for place in places)
                ),
                self._about.reading_um(self._ways.dwell_s),
            ),
            "plan",
            self._coarse,
        )
        ahead = Foresight(
            layout=layout,
            chain=self._about.chain,
            assumed=self._about.assumed,
            increments=self._coarse.increments,
            aim=self._about.aim,
            zone=self._about.zone,
        )
        place_of = {self._driven[place].setup: place for place in places}
        for setup, information in zip(layout.setups, ahead.by_setup.each, strict=True):
            self._information[place_of[setup.name]] = information
        return ahead

    def _each(self, places: Iterable[int]) -> Vector:
        wanted = list(places)
        missing = [place for place in wanted if place not in self._information]
        for first in range(0, len(missing), TOGETHER):
            self._laid_out(missing[first : first + TOGETHER])
        size = len(self._ahead.of.causes)
        return np.array([self._information[place] for place in wanted]).reshape(
            -1, size, size
        )

    def _driving(self, increments: int) -> Vector:
        if increments not in self._driving_min:
            timed = replace(
                self._survey, volume=replace(self._survey.volume, increments=increments)
            )
            ways = [self._ways.of(run) for run in self.lines]
            self._driving_min[increments] = np.array(
                [run_minutes(timed, run) - setup_minutes(timed, run) for run in ways]
            )
        return self._driving_min[increments]

    def beside_um2(self, increments: int) -> float:
        """Return the part of the mean square error that no line reduces: the error of tables
        between targets, waves shorter than two increments, and the floor of
        `solver.planning.information`."""
        hidden = float(np.quantile(hidden_factors(), 0.5)) * self._ahead.hidden_um
        return (
            hidden**2
            + bent_um(self._about.assumed, increments) ** 2
            + self._ahead.of.floor_um**2
        )

    @cached_property
    def _factors(self) -> Vector:
        """Return the transposed factor B' of every line's information, shape (lines, r, q)."""
        value, vector = np.linalg.eigh(self._each(range(len(self.lines))))
        most = int(np.max(np.sum(value > _TOLD, axis=1), initial=1))
        kept = vector[:, :, -most:] * np.sqrt(np.maximum(value[:, None, -most:], 0.0))
        return np.ascontiguousarray(np.swapaxes(kept, 1, 2))

    @cached_property
    def _shows(self) -> Vector:
        value, vector = np.linalg.eigh(self._seen)
        kept = value > _NOTHING * value[-1]
        shown: Vector = vector[:, kept] * np.sqrt(value[kept])
        return shown

    def minutes(self, chosen: Sequence[int], increments: int) -> float:
        """Return the minutes for the chosen lines, including set-up."""
        some = list(chosen)
        bases, first = np.unique(self._base[some], return_index=True)
        shifts = len(some) - len(bases)
        setting = (
            float(np.sum(self._setting_min[some][first]))
            + shifts * self._survey.pace.beam_shift_min
        )
        return float(np.sum(self._driving(increments)[some])) + setting

    def _fitting(
        self, chosen: Sequence[int], increments: int, limit_min: float
    ) -> NDArray[np.int64]:
        some = list(chosen)
        setting = np.where(
            np.isin(self._base, self._base[some]),
            self._survey.pace.beam_shift_min,
            self._setting_min,
        )
        fits = (
            self.minutes(some, increments) + setting + self._driving(increments) <= limit_min
        )
        fits[some] = False
        return np.flatnonzero(fits)

    def _inverted(self, chosen: frozenset[int]) -> Vector:
        return inverse(self._usual + np.sum(self._each(sorted(chosen)), axis=0))

    def square_um2(self, chosen: Sequence[int]) -> float:
        """Return the mean square error over the volume after the chosen lines, without
        `beside_um2`."""
        some = frozenset(chosen)
        if some not in self._square_um2:
            self._square_um2[some] = float(np.sum(self._covariance(some) * self._seen))
        return self._square_um2[some]

    def lowered_um2(self, chosen: Sequence[int]) -> tuple[float, float]:
        """Return the decrease of the mean square error by the chosen lines: mean and standard
        deviation among machines. The decrease and the error after it are independent."""
        with_them = self._covariance(frozenset(chosen)) @ self._seen
        added = self._covariance(frozenset()) @ self._seen - with_them
        variance = 2.0 * np.sum(added * added.T) + 4.0 * np.sum(with_them * added.T)
        return float(np.trace(added)), float(np.sqrt(variance))

    def _seen_through(self, chosen: frozenset[int]) -> _Through:
        factors = self._factors
        count, rank, size = factors.shape
        across = (factors.reshape(-1, size) @ self._covariance(chosen)).reshape(factors.shape)
        return _Through(
            square_um2=self.square_um2([*chosen]),
            inner=across @ np.swapaxes(factors, 1, 2),
            shown=(across.reshape(-1, size) @ self._shows).reshape(count, rank, -1),
            across=across,
        )

    def weighed(self, chosen: Sequence[int], without: Sequence[int] = ()) -> Vector:
        """Return the mean square error for each possible line in addition to the chosen lines,
        shape (lines,). The lines ``without`` are first removed from the choice."""
        left = frozenset(chosen).difference(without)
        if left not in self._added_um2:
            through = self._through(frozenset(chosen))
            for line in without:
                through = through.without(line, self._factors)
            self._added_um2[left] = through.changed(1.0)
        return self._added_um2[left]

    def _without_each(self, chosen: Sequence[int]) -> Vector:
        return self._through(frozenset(chosen)).changed(-1.0)[list(chosen)]

    def improved(self, chosen: Sequence[int], increments: int, limit_min: float) -> list[int]:
        """Return the chosen lines after repeated exchanges within a time limit. Each step makes
        the exchange with the largest gain."""
        now, beside = list(chosen), self.beside_um2(increments)
        square = self.square_um2(now)
        while True:
            best = ((square + beside) * (1.0 - LEAST_GAIN) - beside, now)
            missed = (
                np.argsort(self._without_each(now), kind="stable")[:LEAST_MISSED].tolist()
                if now
                else ()
            )
            for without in ([], *([now[place]] for place in missed)):
                left = [line for line in now if line not in without]
                fitting = self._fitting(left, increments, limit_min)
                if not len(fitting):
                    continue
                found = self.weighed(now, without)[fitting]
                if found.min() < best[0]:
                    # among equally good lines the simplest is chosen
                    first = int(
                        np.argmax(
                            (found <= found.min() + LEAST_GAIN * beside) & (found < best[0])
                        )
                    )
                    best = (float(found[first]), [*left, int(fitting[first])])
            if best[1] is now:
                return now
            square, now = best

    @cached_property
    def _starts(self) -> tuple[tuple[float, tuple[int, ...]], ...]:
        plain = [
            place
            for place, run in enumerate(self.lines)
            if run.setup in (*BODY_DIAGONALS, *LINEAR_RUNS) and not any(run.beam_offset_mm)
        ]
        choices = [
            tuple(place for bit, place in enumerate(plain) if number >> bit & 1)
            for number in range(2 ** len(plain))
        ]
        return tuple(sorted((self.square_um2(choice), choice) for choice in choices))

    def start(self, increments: int, limit_min: float) -> tuple[int, ...]:
        """Return the best choice of lines without a shift within a time limit, or an empty
        choice."""
        return next(
            (
                choice
                for _, choice in self._starts
                if self.minutes(choice, increments) <= limit_min
            ),
            (),
        )


def _increments(survey: Plan, about: Circumstances) -> list[int]:
    """Return the possible numbers of increments: the steps are whole micrometres, and targets do
    not all have the same phase of a ball screw's wave. The second condition is omitted if the plan
    has its own targets or if no number fulfils it. If whole micrometres are impossible, return the
    number of increments in the plan."""
    size = np.array(survey.volume.size_mm)
    whole = [n for n in INCREMENTS if np.allclose(size / n, np.round(size / n, 3), atol=1e-9)]
    own = any(run.targets for run in survey.runs)
    return (
        [n for n in whole if own or n not in about.in_step]
        or whole
        or [survey.volume.increments]
    )


class Search:
    """The search for the best surveys of a volume. The search for each time limit starts from
    the best choice without shifts and from the previous survey."""

    def __init__(self, survey: Plan, about: Circumstances) -> None:
        self._survey, self._about = survey, about
        self.lines = offered(survey, about)
        self._made: dict[Ways, Exchange] = {}
        allowed = _increments(survey, about)
        self._middle, self._finest = min(allowed, key=lambda n: abs(n - MIDDLE)), allowed[-1]
        self._every = every_way(survey.pace.dwell_s, about)
        self._before: tuple[Sequence[int], Ways] = ((), self._every[0])

    def driven(self, ways: Ways) -> Exchange:
        if ways not in self._made:
            self._made[ways] = Exchange(self._survey, self._about, self.lines, ways)
        return self._made[ways]

    def within(self, limit_min: float) -> Plan | None:
        """Return the best survey within a time limit, or None if no line can be driven in this
        time."""
        once = [one for one in self._every if one.passes == 1]
        found = [
            one
            for ways in once
            for one in self._from(
                self.driven(ways).start(self._middle, limit_min),
                ways,
                self._middle,
                limit_min,
            )
        ]
        # the best dwell for few increments is usually the best for many increments
        best = min(found, key=lambda one: one[0])[2] if found else once[0]
        fine = [
            (self.driven(one).start(self._finest, limit_min), one)
            for one in once
            if one is once[0] or one.dwell_s == best.dwell_s
        ]
        for start, ways in (*fine, self._before):
            found += self._from(start, ways, self._finest, limit_min)
        if not found:
            return None
        _, lines, ways, increments = min(found, key=lambda one: one[0])
        self._before = (lines, ways)
        return survey_of(
            self._survey, [self.lines[place] for place in lines], ways, increments
        )

    def _from(
        self, start: Sequence[int], ways: Ways, increments: int, limit_min: float
    ) -> Iterator[tuple[float, list[int], Ways, int]]:
        chosen = self.driven(ways).improved(start, increments, limit_min)
        for _ in range(2):
            others = [
                one
                for one in self._every
                if chosen
                and one.dwell_s == ways.dwell_s
                and self.driven(one).minutes(chosen, increments) <= limit_min
            ]
            if not others:
                return
            ways = min(others, key=lambda one: self.driven(one).square_um2(chosen))
            chosen = self.driven(ways).improved(chosen, increments, limit_min)
            yield (
                self.driven(ways).square_um2(chosen)
                + self.driven(ways).beside_um2(increments),
                chosen,
                ways,
                increments,
            )


def _known_angles(ahead: Foresight, about: Circumstances, runs: Sequence[Run]) -> Vector:
    """Return for each unknown the precision that runs of a head add to the usual precision; only
    pitch and yaw gain precision."""
    shapes, added = ahead.by_setup.shapes, np.zeros(len(ahead.of.causes))
    first = int(np.argmax(ahead.of.turning))
    known = about.head_ranges_urad(runs)
    for name in shapes.names:
        if name in known:
            added[first + shapes.causes_of(name)] = (
                shapes.range_of(name) / known[name]
            ) ** 2 - 1.0
    return added
