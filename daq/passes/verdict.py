"""What is to be said of a survey in the end: what is doubted still, what a person accepted, what stands in for a sensor, and what happened.

A finding belongs to the stop it was made at and leaves with it: what was cured by driving again is history, and hinders nobody.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from stepdiag.daq.passes.doubt import Acceptance, Doubt
from stepdiag.daq.passes.driven import Pass
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.solver.findings import Finding

STATED = ("air-unknown", "sensor-jump")
"""Doubts of conditions: they end where the conditions are stated afterwards."""


def suspected(book: PassBook, findings: Iterable[Finding]) -> list[Doubt]:
    """Return the doubts that the solver's errors make of the readings they name: of a stop, a pass, or every pass of a setup."""
    return [
        doubt
        for found in findings
        if found.severity == "error" and found.setup
        for each in book.of(found.setup)
        if found.pass_number in (None, each.number) and (doubt := _suspect(each, found)) is not None
    ]


def _suspect(each: Pass, found: Finding) -> Doubt | None:
    taken_ns = {index: stop.window_from_ns for index, (stop, _) in each.chosen().items()}
    if not taken_ns or (found.stop is not None and found.stop not in taken_ns):
        return None
    return Doubt(
        setup=found.setup,
        pass_number=each.number,
        stop=found.stop,
        code=found.code,
        text=found.text,
        taken_ns=max(taken_ns.values()) if found.stop is None else taken_ns[found.stop],
        size_um=found.size_um,
    )


def settled_findings(book: PassBook, solved: Iterable[Finding], *, stated: Mapping[str, float]) -> tuple[Finding, ...]:
    """Return what stands in the result: open doubts as errors, accepted ones as warnings with the word that covers them, each once.

    ``stated`` are conditions that somebody gave afterwards: what was doubted of them is settled.
    """
    doubts = [_as_finding(doubt) for doubt in book.doubts() if not (stated and doubt.code in STATED)]
    accepted = [_accepted(doubt, word) for doubt, word in book.accepted()]
    named = {(each.code, each.setup) for each in (*doubts, *accepted)}
    others = [each for each in solved if not (each.severity == "error" and (each.code, each.setup) in named)]
    return tuple(dict.fromkeys((*doubts, *accepted, *_held(book), *others)))


def _as_finding(doubt: Doubt) -> Finding:
    text = f"{doubt.place}: {doubt.text}"
    place = {"setup": doubt.setup, "pass_number": doubt.pass_number, "stop": doubt.stop, "size_um": doubt.size_um}
    return Finding(code=doubt.code, severity="error", text=text, **place)  # type: ignore[arg-type]


def _accepted(doubt: Doubt, word: Acceptance) -> Finding:
    found = _as_finding(doubt)
    moment = datetime.fromtimestamp(word.time_s, UTC).isoformat(timespec="seconds")
    return replace(found, severity="warning", text=f"{found.text}; accepted by {word.name} at {moment}: {word.reason}")


def _held(book: PassBook) -> Iterator[Finding]:
    """Yield which conditions are not those of a sensor, and at how many stops."""
    stops = [stop for each in book.passes for stop, _ in each.chosen().values()]
    for name in dict.fromkeys(name for stop in stops for name in stop.held):
        mine = [stop for stop in stops if name in stop.held]
        text = f"{name}: at {len(mine)} of {len(stops)} stops the sensor is not believed, its last credible value or the survey file's is"
        yield Finding(code="conditions-held", severity="warning", text=text)


def history(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return what happened while recording, in order and each remark once, for the annex of the report."""
    return [found.as_json() for found in dict.fromkeys(findings)]
