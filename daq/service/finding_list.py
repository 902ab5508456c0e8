"""The list of a survey's findings for page and `status`; a restart of the daemon does not change
the list.
"""

from collections.abc import Sequence
from datetime import UTC, datetime

from stepdiag.base.findings import Finding, Severity
from stepdiag.base.messages import Message
from stepdiag.daq.passes.doubt import Acceptance, Doubt
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.survey_time import clock_findings
from stepdiag.daq.records.status import FindingStatus, State

SHOWN = 50
"""Number of newest past findings in the list."""


def finding_list(
    book: PassBook, history: Sequence[Finding], now_s: float | None = None
) -> tuple[FindingStatus, ...]:
    """Return the findings: first past, then accepted, then open findings. ``now_s`` is the time of
    day for the finding about a wrong clock.
    """
    doubts, accepted = book.doubts(), book.accepted()
    settled = {_key(doubt) for doubt in (*doubts, *(doubt for doubt, _ in accepted))}
    past = [each for each in dict.fromkeys(history) if _key(each) not in settled]
    still = [each for each in past if _is_missing(book, each)]
    return (
        *(_past(each) for each in past[-SHOWN:] if each not in still),
        *(_past(each) for each in clock_findings(book, now_s)),
        *(_accepted(doubt, word) for doubt, word in accepted),
        *(_past(each, open_=True) for each in still),
        *(_open(doubt) for doubt in doubts),
    )


def _key(found: Finding | Doubt) -> tuple[object, ...]:
    return found.code, found.setup, found.pass_number, found.stop


def _is_missing(book: PassBook, found: Finding) -> bool:
    passes = (each for each in book.of(found.setup) if each.number == found.pass_number)
    return found.severity != "info" and any(found.stop in each.missing for each in passes)


def _past(found: Finding, *, open_: bool = False) -> FindingStatus:
    known = found.setup and found.pass_number is not None
    place = f"{found.setup}/{found.pass_number}" if known else ""
    if known and found.stop is not None:
        place += f"/{found.stop}"
    facts = {
        "code": found.code,
        "severity": found.severity,
        "text": str(found.words),
        "message": found.message,
        "at": found.place,
    }
    return FindingStatus(**facts, place=place, state="open" if open_ else "past")  # type: ignore[arg-type]


def _open(doubt: Doubt) -> FindingStatus:
    return _doubted("warning", doubt, "open")


def _accepted(doubt: Doubt, word: Acceptance) -> FindingStatus:
    moment = datetime.fromtimestamp(word.time_s, UTC).isoformat(timespec="seconds")
    words = f"{word.name}, {moment}: {word.reason}"
    return _doubted("info", doubt, "accepted", words)


def _doubted(severity: Severity, doubt: Doubt, state: State, word: str = "") -> FindingStatus:
    why = doubt.why if isinstance(doubt.why, Message) else None
    text = str(doubt.words)
    return FindingStatus(
        code=doubt.code,
        severity=severity,
        text=text,
        message=why,
        at=doubt.at,
        place=doubt.place,
        state=state,
        word=word,
    )
