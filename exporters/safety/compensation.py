"""What was active in the control while a machine was measured: part of the measurement, as `survey` in the result says it.

A table made from what a compensated machine still shows, loaded in place of the table that was active, makes the machine worse; one made
from the bare machine and added to it as well. So the survey says it before the first pass, with the very files, and an export whose
profile or files say otherwise is refused. The hashes are those of files that a person read out of the control, with date and way.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from typing import Literal

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, message
from stepdiag.base.settings import UNANSWERED
from stepdiag.exporters.tables.profile import Profile
from stepdiag.solver.result.members import ActiveFile, Facts
from stepdiag.solver.result.result import Result

State = Literal["off", "on"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """The statement about the compensation: ``state`` is None where there is no survey, ``"?"`` where the survey leaves it open."""

    state: Literal["off", "on", "?"] | None = None
    files: tuple[ActiveFile, ...] = ()

    def facts(self, facts: Facts | None = None) -> Facts:
        """Return the facts of a survey with this statement in them."""
        state = None if self.state == UNANSWERED else self.state
        return replace(facts or Facts(), compensation=state, active_files=self.files)

    def words(self) -> str:
        """Return the statement in one line, for log and report."""
        if self.state not in ("off", "on"):
            return "not stated"
        named = "; ".join(f"{file.name} sha256 {file.sha256} ({file.source}, {file.date})" for file in self.files)
        return f"{self.state}: {named}" if named else self.state


def stated(state: Literal["off", "on", "?"] | None, files: Mapping[str, bytes], day: date | None, source: str) -> Statement:
    """Return the statement of a person who hands ``files`` over, as they were active, read out on ``day`` in the way ``source`` says."""
    rows = tuple(
        ActiveFile(name=name, sha256=hashlib.sha256(data).hexdigest(), date="" if day is None else day.isoformat(), source=source)
        for name, data in sorted(files.items())
    )
    return Statement(state=state, files=rows)


def stated_in(result: Result) -> Statement:
    """Return what a result says. Raises ``DataError`` where that is damaged."""
    facts = result.survey
    if facts is None:
        return Statement()
    if facts.compensation is None:
        return Statement(state=UNANSWERED)
    if (facts.compensation == "on") != bool(facts.active_files):
        where, found = f"{result.source}: survey.compensation", f"{facts.compensation!r} with {len(facts.active_files)} active_files"
        raise DataError(where, expected=message("off-on-files"), found=found)
    return Statement(state=facts.compensation, files=facts.active_files)


def require_agreement(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` unless survey, profile and files agree about what was active while the result was measured.

    Codes: ``compensation-unanswered`` (the survey left the question open), ``survey-differs.compensation`` (one says on, the other off),
    ``active-table-unfit.other`` (other files).
    """
    statement = require_answer(result)
    if statement.state is None:
        _require_noted(profile)
        return
    if statement.state != profile.machine.measured_with:
        raise SafetyError(
            f"{profile.source}: machine.measured_with",
            code="survey-differs.compensation",
            expected=message("as-survey", state=statement.state),
            found=message("assumed-state", state=profile.machine.measured_with)
            if profile.assumed
            else f'"{profile.machine.measured_with}"',
            remedy=message("profile-of") if statement.state == "on" else "",
        )
    if statement.state == "on":
        _require_same_files(statement, profile)


def require_answer(result: Result) -> Statement:
    """Return what a result says. Raises ``SafetyError`` (``compensation-unanswered``) where its survey leaves open what was active."""
    statement = stated_in(result)
    if statement.state == UNANSWERED:
        raise SafetyError(
            f"{result.source}: survey.compensation",
            code="compensation-unanswered",
            expected=message("off-or-on"),
            found=message("says-not"),
            remedy=message("say-it-before-first"),
        )
    return statement


def remarks(result: Result, profile: Profile) -> Iterator[Finding]:
    """Yield ``compensation-unanswered.profile`` where nothing but the profile says what was active."""
    if stated_in(result).state is None and not profile.assumed:
        yield finding("warning", message("compensation-unanswered.profile", state=profile.machine.measured_with))


def _require_same_files(statement: Statement, profile: Profile) -> None:
    wanted = {file.sha256: file.name for file in statement.files}
    given = {hashlib.sha256(file.data).hexdigest(): file.name for file in profile.existing}
    if set(wanted) != set(given):
        missing = [name for digest, name in wanted.items() if digest not in given]
        other = [name for digest, name in given.items() if digest not in wanted]
        raise _differs(profile, message("as-they-were-active", names=[file.name for file in statement.files]), missing, other)


def _require_noted(profile: Profile) -> None:
    """Check the files of a profile against the hashes that somebody noted when the files were read out of the control."""
    if profile.machine.measured_with == "off":
        return
    noted = {digest.lower() for digest in profile.machine.active_sha256}
    other = [file.name for file in profile.existing if hashlib.sha256(file.data).hexdigest() not in noted]
    if other or len(noted) != len(profile.existing):
        raise _differs(profile, message("files-noted-as-active"), [], other)


def _differs(profile: Profile, expected: Message, missing: Iterable[str], other: Iterable[str]) -> SafetyError:
    found = [*(message("no-such-file", name=name) for name in missing), *(message("another-file", name=name) for name in other)]
    return SafetyError(
        f"{profile.source}: machine.existing",
        code="active-table-unfit.other",
        expected=expected,
        found=message("comma-list", items=found) if found else message("other-files"),
        remedy=message("very-tables"),
    )


def _listed(files: Iterable[ActiveFile]) -> str:
    return ", ".join(file.name for file in files)
