"""The final findings of a survey: open doubts, accepted doubts, values that replace a sensor, and
events.

A finding belongs to a measurement of a stop. When a repeated pass replaces the measurement, the
finding has no further effect.
"""

from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime

from stepdiag.base.findings import Finding, Severity, finding, warning
from stepdiag.base.messages import Message, Place, message, where
from stepdiag.daq.capture.conditions import CONDITIONS, COURSES
from stepdiag.daq.passes.doubt import Acceptance, Doubt
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.held import Held, held_conditions
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.survey.models import Survey

STATED = ("air-unknown", "sensor-jump")
"""Doubts about conditions, which end when the operator states the conditions afterwards."""


def suspected(book: PassBook, findings: Iterable[Finding]) -> list[Doubt]:
    """Return the doubts from the solver's errors. An error concerns a stop, a pass, or every pass
    of a setup. If the data do not show which of several passes is wrong, the error concerns each of
    these passes.

    An error without a place is a doubt about every pass.
    """
    return [
        doubt
        for found in findings
        if found.severity == "error"
        for each in (book.of(found.setup) if found.setup else book.passes)
        if found.pass_number in (None, each.number)
        and (not found.among or each.place in found.among)
        and (doubt := _suspect(each, found)) is not None
    ]


def _suspect(each: Pass, found: Finding) -> Doubt | None:
    taken_ns = {index: stop.window_from_ns for index, stop in each.chosen().items()}
    if not taken_ns or (found.stop is not None and found.stop not in taken_ns):
        return None
    return Doubt(
        setup=each.route.setup,
        pass_number=each.number,
        stop=found.stop,
        code=found.code,
        why=found.message or found.words,
        way=found.way,
        last=found.last,
        taken_ns=max(taken_ns.values()) if found.stop is None else taken_ns[found.stop],
        size_um=found.size_um,
    )


def settled_findings(
    book: PassBook, solved: Iterable[Finding], *, stated: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Return the findings of the result: open doubts as errors, accepted doubts as warnings with
    their acceptance, without duplicates.

    ``stated`` are conditions entered afterwards; a doubt about only these conditions is settled.
    """
    accepted = [_accepted(doubt, word) for doubt, word in book.accepted()]
    doubts = [_as_finding(doubt) for doubt in book.doubts() if not _settled_by(doubt, stated)]
    named = {
        (each.code, setup) for each in (*doubts, *accepted) for setup in (each.setup, "")
    }
    others = [
        each
        for each in solved
        if not (each.severity == "error" and (each.code, each.setup) in named)
    ]
    return tuple(dict.fromkeys((*doubts, *accepted, *_held(book, stated), *others)))


def _settled_by(doubt: Doubt, stated: Mapping[str, float]) -> bool:
    named = set(_arguments(doubt.why))
    meant = {name for name, condition in CONDITIONS.items() if condition in named}
    return doubt.code in STATED and bool(meant) and meant <= set(stated)


def _arguments(why: object) -> Iterator[object]:
    parts = tuple(why.arguments.values()) if isinstance(why, Message) else why
    for part in parts if isinstance(parts, tuple) else ():
        yield part
        yield from _arguments(part)


def _placed(doubt: Doubt) -> Message:
    return message("doubted-at", place=where(doubt.at), what=doubt.why)


def _as_finding(doubt: Doubt) -> Finding:
    return _finding("error", doubt, _placed(doubt))


def _accepted(doubt: Doubt, word: Acceptance) -> Finding:
    moment = datetime.fromtimestamp(word.time_s, UTC).isoformat(timespec="seconds")
    return _finding(
        "warning",
        doubt,
        message(
            "doubt-accepted",
            what=_placed(doubt),
            name=word.name,
            time=moment,
            reason=word.reason,
        ),
    )


def _finding(severity: Severity, doubt: Doubt, what: Message) -> Finding:
    place = Place(setup=doubt.setup, pass_number=doubt.pass_number, stop=doubt.stop)
    return finding(severity, what, place, code=doubt.code, size_um=doubt.size_um)


def _held(book: PassBook, stated: Mapping[str, float]) -> Iterator[Finding]:
    stops = sum(len(each.chosen()) for each in book.passes)
    for held in held_conditions(book, stated):
        u = message("with-unit", value=held.u, unit=COURSES[held.name].unit)
        yield warning(
            "conditions-held", name=CONDITIONS[held.name], stops=held.stops, count=stops, u=u
        )


def assumed_findings(
    survey: Survey, stops: int, unmeasured: Iterable[Held]
) -> Iterator[Finding]:
    """Yield a finding for each condition of the air that no sensor measured, with the number of
    ``stops``, the value of the survey file and its uncertainty.
    """
    for one in unmeasured:
        unit, value = COURSES[one.name].unit, getattr(survey.environment, one.name)
        stated, u = (
            message("value", value=value, unit=unit),
            message("with-unit", value=one.u, unit=unit),
        )
        yield warning(
            "air-unknown.result",
            name=CONDITIONS[one.name],
            stops=one.stops,
            count=stops,
            stated=stated,
            u=u,
        )
