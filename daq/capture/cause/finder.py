"""Search for a common cause of a pass; findings that the cause may explain wait meanwhile."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.daq.capture.cause.hypotheses import Library
from stepdiag.daq.capture.cause.likelihood import Cause, Evidence, Stand
from stepdiag.daq.capture.log_start import PassHint
from stepdiag.daq.capture.naming.route import Route, agrees
from stepdiag.daq.capture.noise import FAILURE, LEAST_SAMPLES, SERIES
from stepdiag.daq.survey.models import Survey

FIRST, LAST = LEAST_SAMPLES, SERIES
"""The first and the last standstill of a pass after which a cause is searched."""

HELD = frozenset(
    [
        "unexpected-position",
        "wrong-laser-sign",
        "wrong-axis-order",
        "wrong-direction",
        "step-mismatch",
        "laser-reset",
        "no-move",
        "stop-missing",
        "stop-missed",
        "stop-lost",
        "stop-without-reading",
        "count-disagrees",
        "count-stuck",
        "unplanned-setup",
        "window-step",
        "stop-doubtful",
        "reading-differs",
        "place-unknown",
    ]
)
"""Findings not raised before the third standstill: a common cause may explain them."""
EXPLAINED = HELD | {
    "position-differs",
    "between-stops",
    "stop-recovered",
    "other-side",
    "turned-round",
    "count-slip",
    "beam-lost",
}
"""Findings not raised after a cause is named. When the logs are read with the corrected file, the
unexplained findings are raised.
"""

SPOILING = frozenset(["laser.latency_s", "plc.latency_s", "stop.settle_s"])
"""Lines of the survey file that, if wrong, shift the windows of readings in every pass, even if the
steps of the pass fit the file.
"""

Code = Literal[
    "unexpected-position.cause",
    "wrong-laser-sign.cause",
    "wrong-axis-order.cause",
    "step-mismatch.cause",
]
CODES: Mapping[str, Code] = {
    "laser.sign": "wrong-laser-sign.cause",
    "volume.axis_order": "wrong-axis-order.cause",
    "plan.axis_orders": "wrong-axis-order.cause",
    "laser.optics": "step-mismatch.cause",
    "laser.line.scale": "step-mismatch.cause",
    "laser.frames.scale": "step-mismatch.cause",
}
_NAMING = frozenset(
    [
        *CODES.values(),
        "unexpected-position.cause",
        "unexpected-position.cause-code",
        "unexpected-position.cause-left-out",
    ]
)


@dataclass(slots=True)
class CauseFinder:
    """Follows the first standstills of a log. ``named`` are the lines of the survey file named as
    wrong in earlier logs; if there is such a line, no further line is named.
    """

    survey: Survey
    hints: Mapping[str, PassHint]
    named: tuple[str, ...] = ()
    evidence: Evidence = field(default_factory=Evidence)
    held: list[Finding] = field(default_factory=list)
    found: Cause | None = None
    over: bool = False
    plain: bool = False
    """Whether the unchanged survey file has fitted the standstills."""
    undecided: bool = False
    """Whether a finding about two causes with equal fit was raised."""

    def take(self, stand: Stand, setup: str | None, expected: int) -> list[Finding]:
        """Add the next standstill. ``setup`` is the setup that the signals state, ``expected`` the
        stop at which the standstill is expected.

        Return the finding of the cause as soon as the cause is sure, or the withheld findings if
        there is no cause.
        """
        if self.over:
            return []
        stands = self.evidence.stands
        if stands and (stand.reading_mm is None or stand.losses != stands[-1].losses):
            # the beam was cut on the way: the steps before and after the cut belong to different
            # counts
            self.over = True
            return self.released()
        if not stands and expected:
            return self.leave()
        stands.append(stand)
        return self._judged(setup) if len(stands) >= FIRST else []

    def _judged(self, setup: str | None) -> list[Finding]:
        """Return the conclusion from the standstills: the finding of a cause, the finding of two
        causes with equal fit, or the withheld findings.
        """
        causes = self._scored(setup)
        if not causes:
            self.over = len(self.evidence) >= LAST
            return self.released() if self.over else []
        late = any(
            self.evidence.begin(each.route) == 1 for _, each in causes if not each.changes
        )
        best, cause = causes[0]
        rivals = [
            (score, other)
            for score, other in causes[1:]
            if other.kind != cause.kind and best - score <= FAILURE
        ]
        fits = (
            not (cause.changes or rivals or SPOILING & set(self.named))
            and self.evidence.begin(cause.route) is not None
        )
        self.plain = fits or (self.plain and not self.named)
        named = bool(cause.changes) and self.evidence.confirms(cause)
        if named and not rivals:
            self.found, self.over, self.held = cause, True, []
            return (
                [] if self.named else [self._finding(cause)]
            )  # later passes show the consequences of the named line until it is corrected
        self.over = (fits and self.evidence.covers(cause.route)) or (
            len(self.evidence) >= LAST and not late
        )
        alike = [
            other for _, other in rivals if named and all(each.changes for _, each in rivals)
        ]
        news = (
            [_alike(cause, alike[0], len(self.evidence))]
            if alike and not (self.undecided or self.named)
            else []
        )
        self.undecided = self.undecided or bool(news)
        return [*news, *(self.released() if self.over or self._passes_on else [])]

    def misses_first(self, route: Route, after: Stand | None = None) -> bool:
        """Return whether a pass is over and lacks its first stop: its standstills are the second to
        the last stop of the route, and the standstill ``after`` them is not the next stop.

        Until the end of the pass, another order of the axes would make the same steps.
        """
        stands = self.evidence.stands
        judged = self.over or self.plain or bool(self.named)
        if judged or len(stands) != len(route) - 1 or len(stands) < FIRST:
            return False
        if after is not None and after.losses == stands[-1].losses:
            steps = Evidence([stands[-1], after]).steps_mm()
            if any(agrees(float(steps[0]), wanted) for wanted in np.diff(route.nominal_mm)):
                return False
        return self.evidence.begin(route) == 1

    def leave_out(self) -> None:
        """Stop judging a pass that lacks its first stop; discard its withheld findings."""
        self.over, self.held = True, []

    def leave(self) -> list[Finding]:
        """Stop judging the pass, which shows no steps of the laser or continues a judged log;
        return the withheld findings.
        """
        self.over, self.plain = True, not self.named
        return self.released()

    def heed(self, found: Finding) -> list[Finding]:
        """Return a finding if it may be raised now. A finding that a cause may explain is withheld
        until the third standstill, or discarded.
        """
        if (
            found.code not in EXPLAINED
            or found.severity == "info"
            or line_named(found)
            or _is_alike(found)
        ):
            return [found]
        if self.found is not None or (self.named and self.over and not self.plain):
            return []
        if self.over or self._passes_on or (found.code not in HELD and not self.named):
            return [found]
        self.held.append(found)
        return []

    @property
    def _passes_on(self) -> bool:
        """Return whether findings are raised although the pass is still judged: the file has
        fitted, and no earlier pass named a line.
        """
        return self.plain and not self.named

    def released(self) -> list[Finding]:
        """Return the withheld findings, which no cause explains. After a line is named, the
        findings are returned only if the pass fits the file.
        """
        held, self.held = self.held, []
        return held if self.plain or not self.named else []

    def _scored(self, setup: str | None) -> list[tuple[float, Cause]]:
        """Return every hypothesis with the logarithm of its likelihood and prior, best first."""
        library = Library(self.survey, self.hints, self.evidence)
        plain, evidence = list(library.plain(setup)), self.evidence
        causes = [
            each for each in library.hypotheses(setup) if len(evidence) <= len(each.route)
        ]
        scores = [evidence.as_stated(each.route) for each in plain]
        scores += evidence.fits(causes).tolist() if causes else []
        in_time = cache(evidence.in_time)  # most causes share a delay
        both = zip(scores, [*plain, *causes], strict=True)
        scored = [(score + in_time(cause.late_s), cause) for score, cause in both]
        return sorted(scored, key=lambda each: -each[0])

    def _finding(self, cause: Cause) -> Finding:
        (line, value), *others = cause.changes
        more = [f"{name} = {to}" if to else name for name, to in others]
        about = {"what": cause.what or "", "stops": len(self.evidence), "line": line}
        if value:
            code = CODES.get(line, "unexpected-position.cause")
            words = message(code, **about, value="; ".join([value, *more]))
        elif more:
            words = message("unexpected-position.cause-left-out", **about, others=more)
        else:
            words = message("unexpected-position.cause-code", **about)
        return finding("error", words, Place(setup=cause.route.setup))


def line_named(found: Finding) -> str:
    """Return the line of the survey file that a finding names as the cause; empty if the finding
    names no cause.
    """
    return _line_to_correct(found, _NAMING)


def line_to_correct(found: Finding) -> str:
    """Return the line of the survey file whose correction removes the reason of a finding about
    stops or air; empty without such a line.
    """
    return _line_to_correct(found, _NAMING | {"conditions-held.unit"})


def _line_to_correct(found: Finding, keys: frozenset[str]) -> str:
    words = found.message
    return "" if words is None or words.key not in keys else str(words.arguments["line"])


def _is_alike(found: Finding) -> bool:
    return found.message is not None and found.message.key in (
        "step-mismatch.alike",
        "step-mismatch.alike-all-along",
    )


def _alike(one: Cause, other: Cause, stops: int) -> Finding:
    """Return the finding of two causes with equal fit, with the next move that decides."""
    first, second = (
        message("line-is", line=each.changes[0][0], value=each.changes[0][1])
        for each in (one, other)
    )
    place = Place(setup=one.route.setup)
    stop = one.parts_from(other, stops)
    if stop is None:
        return finding(
            "warning",
            message("step-mismatch.alike-all-along", stops=stops, one=first, other=second),
            place,
        )
    axis = one.route.axis_to(stop).upper()
    return finding(
        "warning",
        message(
            "step-mismatch.alike", stops=stops, one=first, other=second, axis=axis, stop=stop
        ),
        place,
    )
