"""Findings as the page shows them: those of one cause and one pass together with their stops, the newest cause first, in every language."""

from collections.abc import Sequence
from typing import Any

from stepdiag.daq.records.status import FindingStatus
from stepdiag.texts import LANGUAGES
from stepdiag.texts.findings import advice_of, place_of, told


def grouped(findings: Sequence[FindingStatus]) -> list[dict[str, Any]]:
    """Return one entry a cause: code, severity, how often, open or past, and per language where it was, what was said and what to do.

    Findings are given in the order in which they arose; a cause that was said again stands where it was said last.
    """
    groups: dict[tuple[str, str, str], list[FindingStatus]] = {}
    for one in findings:
        key = (one.state, one.code, place_of(one.text).run)
        groups[key] = [*groups.pop(key, []), one]
    return [_entry(members) for members in reversed(groups.values())]


def _entry(members: Sequence[FindingStatus]) -> dict[str, Any]:
    last = members[-1]
    order = ("info", "warning", "error")
    stops = sorted({stop for one in members if (stop := place_of(one.text).stop) is not None})
    severity = max((one.severity for one in members), key=order.index)
    said = {language: told(last.code, last.text, language, stops) for language in LANGUAGES}
    todo = {language: advice_of(last.code, language) for language in LANGUAGES}
    places = sorted({one.place for one in members if one.place})
    about = {"state": last.state, "places": places, "word": last.word}
    return {"code": last.code, "severity": severity, "times": len(members), "said": said, "advice": todo, **about}
