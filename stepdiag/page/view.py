"""A snapshot for the browser as two events: the parts that change with a stop or a setup, and the
parts that are sent with every snapshot.

The data contain the sentences in every language and the places in the volume in mm, so the browser
computes nothing.
"""

from collections.abc import Sequence
from typing import Any

import msgspec

from stepdiag.base.findings import in_words
from stepdiag.base.messages import in_every_language, where
from stepdiag.daq.records.status import (
    FindingStatus,
    LinkStatus,
    SetupStatus,
    Snapshot,
    StopStatus,
)
from stepdiag.page.stage import headline
from stepdiag.texts import LANGUAGES
from stepdiag.texts.explained import advice_of
from stepdiag.texts.setup_words import setup_words

SLOW_FIELDS = (
    "survey",
    "machine",
    "operator",
    "workpiece",
    "setups",
    "stops",
    "findings",
    "origin_mm",
    "size_mm",
    "increments",
    "geometry",
    "expects_setup",
    "expects_pass",
    "result_ready",
    "to_drive",
)
"""Names of the parts of a snapshot that change with a stop or a setup; all other parts are sent
with every snapshot."""
SEVERITIES = ("info", "warning", "error")
SHAPED = frozenset({"setups", "stops", "findings", "origin_mm", "size_mm", "increments"})
"""Names of the parts that the browser receives in another form than the daemon has."""
FAST_FIELDS = tuple(
    name
    for name in Snapshot.__struct_fields__
    if name not in SLOW_FIELDS and name not in SHAPED
)


def survey_view(now: Snapshot) -> dict[str, Any]:
    """Return the parts of a snapshot that change with a stop or a setup."""
    plain = {name: getattr(now, name) for name in SLOW_FIELDS if name not in SHAPED}
    return {
        **plain,
        "setups": [_setup(one) for one in now.setups],
        "stops": [_stop(one) for one in now.stops],
        "findings": grouped(now.findings),
    }


def now_view(now: Snapshot) -> dict[str, Any]:
    """Return the parts of a snapshot that are sent every time."""
    plain = {name: getattr(now, name) for name in FAST_FIELDS}
    head = headline(now)
    return {
        **plain,
        **{link: _link(getattr(now, link)) for link in ("laser", "plc", "head", "air")},
        "message": in_every_language(now.message),
        "ahead": {"words": in_every_language(now.ahead.words), "further": now.ahead.further},
        "stage": head.stage,
        "alarm": head.alarm,
        "lead": head.lead,
        "advice": head.advice,
        "watching": head.watching or head.advice,
    }


def _setup(one: SetupStatus) -> dict[str, Any]:
    return {
        **msgspec.to_builtins(one),
        "words": {language: setup_words(one.name, language) for language in LANGUAGES},
        "reason": in_every_language(one.reason),
        "doubt": in_every_language(one.doubt),
    }


def _stop(one: StopStatus) -> dict[str, Any]:
    return {**msgspec.to_builtins(one), "doubtful": in_every_language(one.doubtful)}


def _link(one: LinkStatus | None) -> dict[str, Any] | None:
    return (
        None
        if one is None
        else {**msgspec.to_builtins(one), "detail": in_every_language(one.detail)}
    )


def grouped(findings: Sequence[FindingStatus]) -> list[dict[str, Any]]:
    """Return one entry per cause of findings: code, severity, number, open or past, and by language
    its sentence and remedy.

    ``findings`` are in the order of their occurrence. In the result, errors come before warnings,
    open findings before past findings, new findings before old findings.
    """
    groups: dict[tuple[str, ...], list[FindingStatus]] = {}
    for one in findings:
        stream = "" if one.message is None else str(one.message.arguments.get("stream", ""))
        key = (one.state, one.code, stream, _run_and_stop(one)[0])
        groups[key] = [*groups.pop(key, []), one]
    entries = [_entry(members) for members in reversed(groups.values())]
    return sorted(
        entries,
        key=lambda entry: (-SEVERITIES.index(entry["severity"]), entry["state"] != "open"),
    )


def _run_and_stop(one: FindingStatus) -> tuple[str, int | None]:
    return f"{one.at.setup} {one.at.way}", one.at.stop


def _entry(members: Sequence[FindingStatus]) -> dict[str, Any]:
    last = members[-1]
    stops = sorted({stop for one in members if (stop := _run_and_stop(one)[1]) is not None})
    severity = max((one.severity for one in members), key=SEVERITIES.index)
    sentence = {language: in_words(last.finding, language, stops) for language in LANGUAGES}
    todo = {language: advice_of(last.code, language) for language in LANGUAGES}
    places = {one.place: in_every_language(where(one.at)) for one in members if one.place}
    about = {"state": last.state, "places": dict(sorted(places.items())), "word": last.word}
    return {
        "code": last.code,
        "severity": severity,
        "times": len(members),
        "sentence": sentence,
        "advice": todo,
        **about,
    }
