"""The compensation that was active in the control during the measurement. The survey file states
the compensation and the active files before the first pass.

Two mistakes make the machine worse. A table from the residual error of a compensated machine must
not replace the active table. A table from the error of the uncompensated machine must not be added
to the active table. So an export is refused if its profile or files contradict the survey. The
hashes are those of files that the operator read out of the control, with the date and the way of
reading.
"""

import hashlib
from collections.abc import Iterable, Iterator

from stepdiag.base.compensation import Statement, stated_in
from stepdiag.base.errors import SafetyError
from stepdiag.base.findings import Finding, warning
from stepdiag.base.messages import Message, message
from stepdiag.base.result.result import Result
from stepdiag.base.settings import UNANSWERED
from stepdiag.exporters.tables.profile import Profile


def require_agreement(result: Result, profile: Profile) -> None:
    """Raise ``SafetyError`` unless survey, profile and files state the same active compensation
    during the measurement.

    The codes are ``compensation-unanswered`` (the survey states nothing),
    ``survey-differs.compensation`` (survey and profile state different switch positions) and
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
    """Return the statement of a result. Raises ``SafetyError`` (``compensation-unanswered``) if the
    survey does not state the active compensation.
    """
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
    """Yield ``compensation-unanswered.profile`` if the profile names active files and the survey
    does not.
    """
    if stated_in(result).state is None and not profile.assumed:
        state = (
            message("state-on")
            if profile.machine.measured_with == "on"
            else message("state-off")
        )
        yield warning("compensation-unanswered.profile", state=state)


def _require_same_files(statement: Statement, profile: Profile) -> None:
    wanted = {file.sha256: file.name for file in statement.files}
    given = {hashlib.sha256(file.data).hexdigest(): file.name for file in profile.existing}
    if set(wanted) != set(given):
        missing = [name for digest, name in wanted.items() if digest not in given]
        other = [name for digest, name in given.items() if digest not in wanted]
        raise _differs(
            profile,
            message("as-they-were-active", names=[file.name for file in statement.files]),
            missing,
            other,
        )


def _require_noted(profile: Profile) -> None:
    """Raise SafetyError for a file of the profile without the hash that was noted when the file was
    read out of the control.
    """
    if profile.machine.measured_with == "off":
        return
    noted = {digest.lower() for digest in profile.machine.active_sha256}
    other = [
        file.name
        for file in profile.existing
        if hashlib.sha256(file.data).hexdigest() not in noted
    ]
    if other or len(noted) != len(profile.existing):
        raise _differs(profile, message("files-noted-as-active"), [], other)


def _differs(
    profile: Profile, expected: Message, missing: Iterable[str], other: Iterable[str]
) -> SafetyError:
    found = [
        *(message("no-such-file", name=name) for name in missing),
        *(message("another-file", name=name) for name in other),
    ]
    return SafetyError(
        f"{profile.source}: machine.existing",
        code="active-table-unfit.other",
        expected=expected,
        found=message("comma-list", items=found) if found else message("other-files"),
        remedy=message("very-tables"),
    )
