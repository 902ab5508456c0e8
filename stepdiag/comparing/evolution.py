"""Theory of operation: changes of a machine between its surveys.

The values of a quantity at N nodes in T surveys are

    y[t, n] = level[n] + sum_j a_j[n] g_j(t) + common[n] + e[t, n],      e ~ normal(0, u_own[t, n])

- ``u_own`` is the own uncertainty of each survey: its combined uncertainty less the part common to
  all surveys with the same instruments (unmeasured angles, wavelength, sensors). The common part
  shifts all values equally; it is added again when a value is compared with a tolerance. A survey
  with other instruments has another common part, which is added to its ``u_own``.
- ``u_own`` is widened if the surveys of the machine scatter more than ``u_own`` explains. The
  scatter is computed from the median of all differences between neighbouring surveys, less the part
  explained by ``u_own``, and is at most `LARGEST_SCATTER` times u. A change affects a single
  difference of a quantity, so it hardly affects the median.
- ``g_j`` are courses: known breaks (loaded tables) are in every model; a step between two surveys,
  a line, a run-in 1 - exp(-t / tau), a season (sine and cosine of a year) are searched. A slope
  continues through breaks and steps.

The gain of a course is twice its gain in log-likelihood at its best node (chi-squared). A course is
accepted if its gain exceeds the largest gain that chance causes in all tests of the machine
(`stepdiag.comparing.chance`). The number of tests is the number of nodes of all quantities times
the number of courses. Lines, and steps at surveys with a named event, are tested first; in this
first test, only these few courses are counted. Courses compete by

    log evidence = gain / 2 - log(number of courses of their kind)

so the course with the largest evidence is accepted first, and the search continues with the
remaining courses. The probability of a course is its share of the evidence of all courses. The
interval in which a step began contains `HELD` of the evidence of all steps. The latest date at
which a line leaves the tolerance is given only if lines have at least `HELD` of the evidence,
because a step or a run-in does not continue. A season can fit any values of two or three visits a
year; it is accepted only if steps and lines have less than 1 - `HELD` of the evidence.

A quantity is "changed" if a course is accepted. It is "unchanged" if no course is accepted and a
change of three U is excluded at every survey. This also excludes a change that is reversed before
the next survey (`_lone`). Any other quantity is "undecided"; the result then contains the number of
further surveys that would decide.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.comparing.chance import DENIABLE, ERRS, EXCLUDED, Verdict

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal["step", "line", "run-in", "season"]

LARGEST_SCATTER = 3.0
"""Largest accepted scatter beyond U in standard uncertainties. A larger scatter means that the
differences are changes, or that U is wrong."""
ENOUGH = 8
"""Least number of differences for an estimate of the scatter from their median; the estimate is
then uncertain by a third."""
HELD = 0.95
MOST_COURSES = 5
"""Largest number of reported changes of one quantity; smaller changes are left out."""
RUN_INS = (0.1, 0.25, 0.5)
"""Time constants of a run-in as shares of the observed time. A run-in with a longer constant looks
like a line."""
TOO_ALIKE = 1e-9
"""Other courses are fitted to a course and subtracted from it. If the squared remainder is less
than this share of the weights, the course counts as a combination of these courses."""
SEASON_YEARS, SEASON_SURVEYS = 1.0, 6
"""Period of a season in years, and the least number of surveys for a season: the surveys must
contain more values than the season has unknowns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """A quantity over the surveys of a machine: ``values``, ``u`` and ``u_own`` (the part of u that
    differs from survey to survey), shapes (surveys, nodes); NaN for a survey without the quantity.
    """

    values: Array
    u_own: Array
    u: Array

    def widened(self, scatter: float) -> "Figures":
        return (
            self
            if not scatter
            else replace(self, u_own=np.hypot(self.u_own, scatter * self.u))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Calendar:
    """The surveys of a machine: ``years`` since the first survey, ``broken`` if tables were loaded
    before the survey, ``named`` if the survey file contains an event."""

    years: Array
    broken: Mask
    named: Mask

    def of(self, kept: Mask) -> "Calendar":
        """Return the calendar of the surveys that ``kept`` marks. An event before an omitted survey
        moves to the next survey."""
        if kept.all():
            return self
        places = np.flatnonzero(kept)
        behind = np.searchsorted(places, np.arange(len(kept)))
        broken, named = (
            np.isin(np.arange(len(places)), behind[each])
            for each in (self.broken, self.named)
        )
        return Calendar(
            years=self.years[places],
            broken=broken & (np.arange(len(places)) > 0),
            named=named,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """An accepted course. ``first`` and ``last`` are the surveys between which the course began;
    ``probability`` is its share of the evidence.

    ``size`` and ``u`` (um, urad or um/m; per year for a line) are those at ``node``, the node with
    the most significant size.
    """

    kind: Kind
    at: int
    first: int
    last: int
    node: int
    size: float
    u: float
    probability: float
    known: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """The evolution of a quantity. ``further`` is the number of further surveys that would decide
    an undecided quantity, None if no number decides it."""

    verdict: Verdict
    courses: tuple[Course, ...]
    further: int | None = None

    def renumbered(self, numbers: Mapping[int, int]) -> "Explained":
        if not self.courses:
            return self
        return replace(self, courses=tuple(_placed(each, numbers) for each in self.courses))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidates:
    """The courses to test: columns, shape (surveys, courses), with kind, place and logarithm of the
    prior of each course."""

    columns: Array
    kinds: tuple[Kind, ...]
    places: NDArray[np.int64]
    log_prior: Array


def scatter(figures: Sequence[Figures], calendar: Calendar) -> float:
    """Return the scatter of a machine's surveys beyond their own uncertainty as a factor of u, 0 to
    `LARGEST_SCATTER`."""
    if not figures:
        return 0.0
    values, own, u = (
        np.hstack([getattr(each, name) for each in figures])
        for name in ("values", "u_own", "u")
    )
    steps, expected, whole = (
        np.abs(np.diff(values, axis=0)),
        np.hypot(own[1:], own[:-1]),
        np.hypot(u[1:], u[:-1]),
    )
    usable = np.isfinite(steps) & (expected > 0) & (whole > 0) & ~calendar.broken[1:, None]
    independent = len(figures) * int(np.count_nonzero(usable.any(axis=1)))
    return beyond(steps[usable], expected[usable], whole[usable], independent)


def beyond(steps: Array, expected: Array, whole: Array, independent: int) -> float:
    """Return the scatter of differences beyond their own standard uncertainty ``expected``, as a
    factor; ``whole`` is their complete standard uncertainty.

    ``independent`` is the number of independent differences, because the nodes of one function vary
    together.
    """
    if min(independent, len(steps)) < ENOUGH:
        return 0.0
    normal = NormalDist().inv_cdf(0.75)
    larger = float(np.median(steps / expected)) / normal
    if larger <= 1.0:
        return 0.0
    total = float(np.median(steps / whole)) / normal * (1 + 1 / math.sqrt(independent))
    return min(
        math.sqrt(max(total**2 - float(np.median(expected / whole)) ** 2, 0.0)),
        LARGEST_SCATTER,
    )


def explained(figures: Sequence[Figures], calendar: Calendar) -> list[Explained]:
    questions = sum(each.values.shape[1] for each in figures)
    together: dict[bytes, list[int]] = {}
    for number, each in enumerate(figures):
        together.setdefault(_kept(each).tobytes(), []).append(number)
    found: dict[int, Explained] = {}
    for numbers in together.values():
        found |= zip(
            numbers,
            _explained([figures[number] for number in numbers], calendar, questions),
            strict=True,
        )
    return [found[number] for number in range(len(figures))]


def _kept(figures: Figures) -> Mask:
    finite = np.isfinite(figures.values + figures.u_own)
    kept: Mask = np.all(finite, axis=1)
    return kept


def _explained(
    figures: Sequence[Figures], calendar: Calendar, questions: int
) -> Iterator[Explained]:
    kept = _kept(figures[0])
    if np.count_nonzero(kept) < 2:
        yield from (Explained(verdict="undecided", courses=()) for _ in figures)
        return
    days = calendar.of(kept)
    candidates, surveys = _candidates(days), np.flatnonzero(kept)
    values = np.hstack([each.values[kept] for each in figures])
    with np.errstate(divide="ignore"):
        weights = np.hstack([each.u_own[kept] ** -2.0 for each in figures])
    weights[:, ~np.isfinite(weights).all(axis=0)] = (
        0.0  # a node that is zero by definition cannot change
    )
    gains = _gains_beside_levels(values, weights, days, candidates)
    limits = _thresholds(candidates, days, questions)
    u = np.hstack([each.u[kept] for each in figures])
    hidden, lone = _hidden(u, weights, candidates, gains), _lone(u, values, weights, days)
    end = 0
    for each in figures:
        mine = slice(end, end := end + each.values.shape[1])
        if not np.any(weights[:, mine]):
            yield Explained(verdict="undecided", courses=())
        else:
            search = _Search(
                values[:, mine], weights[:, mine], days, candidates, limits, questions
            )
            worth = np.any(days.broken) or np.any(
                gains.gain[:, mine].max(axis=1, initial=0.0) > limits
            )
            courses = search.courses(gains.of(mine), surveys) if worth else ()
            if courses:
                yield Explained(verdict="changed", courses=courses)
            else:
                yield _unchanged(hidden[:, mine], lone[mine], search, gains.of(mine))


def _base(days: Calendar) -> Array:
    count = np.arange(len(days.years))
    return np.column_stack(
        [np.ones(len(count)), *(count >= at for at in np.flatnonzero(days.broken))]
    ).astype(float)


def _thresholds(candidates: "_Candidates", days: Calendar, questions: int) -> Array:
    """Return the gain of each course above which the course is accepted, shape (courses,). For an
    unchanged machine, the probability that a course exceeds its gain is `ERRS`, for all tests
    together: the first tests (lines and named steps) and the tests of all courses."""
    events = int(np.count_nonzero(days.named[1:]))
    first = np.array(
        [
            kind == "line" or (kind == "step" and days.named[at])
            for kind, at in zip(candidates.kinds, candidates.places, strict=True)
        ]
    )
    asked = (
        np.where(first, 1 + events, len(candidates.kinds)) * questions * (2 if events else 1)
    )
    chance = ERRS / np.maximum(asked, 1)
    rare: list[float] = chance.tolist()
    normal = {each: NormalDist().inv_cdf(1 - each / 2) ** 2 for each in set(rare)}
    seasons = np.array([kind == "season" for kind in candidates.kinds], dtype=bool)
    found: Array = np.where(seasons, -2.0 * np.log(chance), [normal[each] for each in rare])
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Gains:
    """The gain of each course (the decrease of chi-squared), its size, and the standard uncertainty
    of the size, shapes (courses, nodes)."""

    gain: Array
    size: Array
    u: Array

    def of(self, nodes: slice) -> "_Gains":
        return _Gains(gain=self.gain[:, nodes], size=self.size[:, nodes], u=self.u[:, nodes])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Taken:
    number: int
    probability: float
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class _Search:
    values: Array
    weights: Array
    days: Calendar
    candidates: _Candidates
    limits: Array
    questions: int

    def courses(self, gains: _Gains, surveys: NDArray[np.int64]) -> tuple[Course, ...]:
        """Return the accepted courses. ``gains`` are relative to a model with only the known
        breaks; ``surveys`` are the numbers of the used surveys among all surveys."""
        taken: list[_Taken] = []
        while len(taken) < MOST_COURSES and (following := self._next(gains)) is not None:
            taken.append(following)
            gains = _gains(self.values, self.weights, self._design(taken), self.candidates)
        if not taken and not np.any(self.days.broken):
            return ()
        return tuple(
            _placed(course, surveys)
            for course in sorted(self._sized(taken), key=lambda course: course.at)
        )

    def _design(self, taken: Sequence[_Taken]) -> Array:
        return np.column_stack(
            [_base(self.days), *(self._columns(each.number) for each in taken)]
        )

    def _columns(self, number: int) -> Array:
        """Return the columns of a candidate: two columns for a season, otherwise one."""
        width = 2 if self.candidates.kinds[number] == "season" else 1
        return self.candidates.columns[:, number : number + width]

    def _next(self, gains: _Gains) -> _Taken | None:
        best = gains.gain.max(axis=1, initial=0.0)
        evidence = np.where(best > self.limits, best / 2 + self.candidates.log_prior, -np.inf)
        if not np.any(np.isfinite(evidence)):
            return None
        kinds = np.array(self.candidates.kinds)
        share = best / 2 + self.candidates.log_prior
        share = np.exp(share - share.max())
        share /= share.sum()
        for simple, others in (("step", ("line", "run-in", "season")), ("line", ("season",))):
            like, wider = kinds == simple, np.isin(kinds, others)
            if share[wider].sum() < HELD * share[wider | like].sum() and np.any(
                np.isfinite(evidence[like])
            ):
                evidence[
                    wider
                ] = -np.inf  # at once or gradually: the interval must include both
        number = int(np.argmax(evidence))
        alike = np.where(kinds == kinds[number], share, 0.0)
        first, last = self._since(number, alike)
        return _Taken(number=number, probability=float(alike.sum()), first=first, last=last)

    def _since(self, number: int, alike: Array) -> tuple[int, int]:
        if self.candidates.kinds[number] != "step":
            return 0, len(self.values) - 1
        order = np.argsort(-alike)
        reached = np.cumsum(alike[order]) / alike.sum()
        places = self.candidates.places[order[: int(np.searchsorted(reached, HELD)) + 1]]
        return int(places.min()) - 1, int(places.max())

    def _sized(self, taken: Sequence[_Taken]) -> Iterator[Course]:
        breaks = np.flatnonzero(self.days.broken).tolist()
        sizes, u = _sized(self.values, self.weights, self._design(taken))
        limit = NormalDist().inv_cdf(1 - ERRS / 2 / max(len(breaks), 1) / self.questions)
        for row, at in enumerate(breaks, start=1):
            node = _standing_out(sizes[row], u[row])
            if abs(sizes[row, node]) > limit * u[row, node]:
                size, uncertainty = float(sizes[row, node]), float(u[row, node])
                yield Course(
                    kind="step",
                    at=at,
                    first=at - 1,
                    last=at,
                    node=node,
                    size=size,
                    u=uncertainty,
                    probability=1.0,
                    known=True,
                )
        row = 1 + len(breaks)
        for each in taken:
            kind = self.candidates.kinds[each.number]
            node = _standing_out(sizes[row], u[row])
            size = (
                math.hypot(*sizes[row : row + 2, node])
                if kind == "season"
                else float(sizes[row, node])
            )
            yield Course(
                kind=kind,
                at=int(self.candidates.places[each.number]),
                first=each.first,
                last=each.last,
                node=node,
                size=size,
                u=float(u[row, node]),
                probability=each.probability,
            )
            row += self._columns(each.number).shape[1]


def _hidden(u: Array, weights: Array, candidates: _Candidates, gains: _Gains) -> Mask:
    """Return at which steps and nodes a change of `DENIABLE` U is not excluded, shape (steps,
    nodes)."""
    steps = np.array(
        [number for number, kind in enumerate(candidates.kinds) if kind == "step"],
        dtype=np.int64,
    )
    at = candidates.places[steps]
    allowed = 2 * DENIABLE * np.hypot(u[at - 1], u[at])
    found: Mask = np.any(weights, axis=0) & (
        np.abs(gains.size[steps]) + EXCLUDED * gains.u[steps] > allowed
    )
    return found


def _lone(u: Array, values: Array, weights: Array, days: Calendar) -> Mask:
    """Return the nodes at which a single survey can be off by `DENIABLE` U, shape (nodes,): a step
    does not show a change that was reversed before the next survey.

    The first and the last survey between two known breaks are not tested, because a step shows a
    change there.
    """
    found: Mask = np.zeros(values.shape[1], dtype=bool)
    for level in _base_levels(days):
        own, inner = (
            weights[level],
            slice(level.start + 1, max(level.stop - 1, level.start + 1)),
        )
        mine = weights[inner]
        others = own.sum(axis=0) - mine
        usable = (mine > 0) & (others > 0)
        middle = np.divide(
            (own * values[level]).sum(axis=0) - mine * values[inner],
            others,
            out=np.zeros_like(mine),
            where=usable,
        )
        certain = np.sqrt(
            sum(
                np.divide(1.0, each, out=np.zeros_like(mine), where=usable)
                for each in (mine, others)
            )
        )
        allowed = 2 * DENIABLE * np.hypot(u[inner], u[level.start : inner.stop - 1])
        found |= np.any(
            usable & (np.abs(values[inner] - middle) + EXCLUDED * certain > allowed), axis=0
        )
    return found


def _unchanged(hidden: Mask, lone: Mask, search: _Search, gains: _Gains) -> Explained:
    if np.any(lone):
        return Explained(verdict="undecided", courses=())
    if not np.any(hidden):
        return Explained(verdict="unchanged" if len(hidden) else "undecided", courses=())
    places = [
        at
        for at, kind in zip(
            search.candidates.places.tolist(), search.candidates.kinds, strict=True
        )
        if kind == "step"
    ]
    with np.errstate(divide="ignore"):
        own = search.weights**-0.5
    size = np.abs(gains.size[: len(places)])
    further = [
        _surveys_to_decide(size[row, node], own[:, node], places[row], search.questions)
        for row, node in np.argwhere(hidden)
    ]
    decided = [each for each in further if each is not None]
    return Explained(
        verdict="undecided",
        courses=(),
        further=max(decided) if len(decided) == len(further) else None,
    )


def _standing_out(sizes: Array, u: Array) -> int:
    return int(np.argmax(np.divide(np.abs(sizes), u, out=np.zeros(len(u)), where=u > 0)))


def _placed(course: Course, numbers: Mapping[int, int] | NDArray[np.int64]) -> Course:
    return replace(
        course,
        at=int(numbers[course.at]),
        first=int(numbers[course.first]),
        last=int(numbers[course.last]),
    )


def _surveys_to_decide(size: float, own: Array, at: int, questions: int) -> int | None:
    limit = NormalDist().inv_cdf(1 - ERRS / 2 / (questions * len(own)))
    before = np.sum(own[:at] ** -2.0)
    for more in range(1, 11):
        behind = np.sum(own[at:] ** -2.0) + more * np.mean(own**-2.0)
        if size > limit * math.sqrt(1 / before + 1 / behind):
            return more
    return None


def _candidates(calendar: Calendar) -> _Candidates:
    """Return the courses to test for a number of surveys: steps from two surveys on, a line from
    four, run-ins and seasons from six."""
    years, count = calendar.years, len(calendar.years)
    kinds: list[Kind] = []
    columns: list[Array] = []
    places: list[int] = []
    prior: list[float] = []
    steps = [at for at in range(1, count) if not calendar.broken[at]]
    named = max(int(np.count_nonzero(calendar.named[1:])), 1)
    for at in steps:
        kinds.append("step")
        columns.append((np.arange(count) >= at).astype(float))
        places.append(at)
        prior.append(-math.log(4 * named if calendar.named[at] else 4 * len(steps)))
    span = float(years[-1] - years[0])
    if count >= 4 and span > 0:
        kinds.append("line")
        columns.append(years - years.mean())
        places.append(0)
        prior.append(-math.log(4))
    if count >= SEASON_SURVEYS and span > 0:
        for share in RUN_INS:
            kinds.append("run-in")
            columns.append(1 - np.exp(-(years - years[0]) / (share * span)))
            places.append(0)
            prior.append(-math.log(4 * len(RUN_INS)))
    if count >= SEASON_SURVEYS and span > SEASON_YEARS:
        for wave, log_prior in zip(waves_of(years), (-math.log(4), -np.inf), strict=True):
            kinds.append("season")
            columns.append(wave)
            places.append(0)
            prior.append(log_prior)
    return _Candidates(
        columns=np.column_stack(columns) if columns else np.zeros((count, 0)),
        kinds=tuple(kinds),
        places=np.array(places, dtype=np.int64),
        log_prior=np.array(prior),
    )


def waves_of(years: Array) -> tuple[Array, Array]:
    """Return the sine and the cosine column of a season, shape (surveys,) each."""
    return np.sin(2 * np.pi * years / SEASON_YEARS), np.cos(2 * np.pi * years / SEASON_YEARS)


def _gains_beside_levels(
    values: Array, weights: Array, days: Calendar, candidates: _Candidates
) -> _Gains:
    """Return the gains of each course relative to a model of levels between known breaks, computed
    from sums because a machine has thousands of courses."""
    columns = candidates.columns
    pair = candidates.kinds.index("season") if "season" in candidates.kinds else None
    rest, norm = values.copy(), (columns**2).T @ weights
    cross = (
        np.zeros(0) if pair is None else (columns[:, pair] * columns[:, pair + 1]) @ weights
    )
    for level in _base_levels(days):
        mine = weights[level]
        total = mine.sum(axis=0)
        total[total == 0.0] = 1.0
        rest[level] -= np.sum(mine * values[level], axis=0) / total
        sums = columns[level].T @ mine
        norm -= sums**2 / total
        if pair is not None:
            cross -= sums[pair] * sums[pair + 1] / total
    along = columns.T @ (weights * rest)
    found = _gained(along, norm, np.sum(weights, axis=0))
    if pair is not None:
        (a, b), (x, y) = norm[pair : pair + 2], along[pair : pair + 2]
        determinant = a * b - cross**2
        usable = determinant > TOO_ALIKE * a * b
        both = np.divide(
            b * x**2 - 2 * cross * x * y + a * y**2,
            determinant,
            out=np.zeros_like(a),
            where=usable,
        )
        found.gain[pair], found.gain[pair + 1] = both, 0.0
    return found


def _base_levels(days: Calendar) -> list[slice]:
    edges = [0, *np.flatnonzero(days.broken).tolist(), len(days.years)]
    return [slice(begin, end) for begin, end in pairwise(edges)]


def _gained(along: Array, norm: Array, total: Array) -> _Gains:
    usable = norm > TOO_ALIKE * total
    size, squared = (
        np.divide(one, norm, out=np.zeros_like(norm), where=usable)
        for one in (along, np.ones_like(norm))
    )
    return _Gains(gain=along * size, size=size, u=np.sqrt(squared))


def _gains(values: Array, weights: Array, base: Array, candidates: _Candidates) -> _Gains:
    root = np.sqrt(weights).T[:, :, None]
    q, _ = np.linalg.qr(base * root)
    rest = values.T[:, :, None] * root
    rest = rest - q @ (q.transpose(0, 2, 1) @ rest)
    columns = candidates.columns * root
    beside = columns - q @ (q.transpose(0, 2, 1) @ columns)
    norm, along = np.sum(beside**2, axis=1), np.sum(beside * rest, axis=1)
    found = _gained(along.T, norm.T, np.sum(weights, axis=0))
    if "season" in candidates.kinds:
        at = candidates.kinds.index("season")
        found.gain[at], found.gain[at + 1] = _together(beside[:, :, at : at + 2], rest), 0.0
    return found


def _together(pair: Array, rest: Array) -> Array:
    """Return the decrease of chi-squared by two columns together, shape (nodes,)."""
    products = pair.transpose(0, 2, 1) @ pair
    along = pair.transpose(0, 2, 1) @ rest
    found: Array = np.einsum(
        "nik,nij,njk->n", along, np.linalg.pinv(products, hermitian=True), along
    )
    return found


def fit(values: Array, weights: Array, design: Array) -> tuple[Array, Array]:
    """Return the amounts of the columns of a design at every node, shape (columns, nodes), and
    their covariances, one matrix per node."""
    normal = np.einsum("ti,tn,tj->nij", design, weights, design)
    covariance: Array = np.linalg.pinv(normal, hermitian=True)
    amounts: Array = np.einsum("nij,tj,tn->in", covariance, design, weights * values)
    return amounts, covariance


def _sized(values: Array, weights: Array, design: Array) -> tuple[Array, Array]:
    """Return the amounts of the columns of a design at every node and their standard uncertainties,
    shapes (columns, nodes)."""
    amounts, covariance = fit(values, weights, design)
    return amounts, np.sqrt(np.einsum("nii->in", covariance))
