"""``stepdiag accept``: a person's statement that doubted readings of a survey may be used."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.cli.completion import Verbose
from stepdiag.terminal.viewer import print_first, print_words

if TYPE_CHECKING:
    from datetime import datetime


FEW = 5
"""Number of doubts that are printed without ``--verbose``: accepted doubts, and open doubts."""


def register(app: typer.Typer) -> None:
    app.command("accept")(accept)


def accept(
    survey: Path,
    stop: str,
    reason: Annotated[str, typer.Option()],
    name: str = "",
    begun: str | None = None,
    verbose: Verbose = False,
) -> None:
    """Accept doubted readings, or state the time of a survey."""
    import getpass
    import time

    from stepdiag.base.errors import UsageError
    from stepdiag.daemon.survey_state import standing_of
    from stepdiag.daq.passes.survey_time import CODE
    from stepdiag.daq.recording.verdicts import accept as note
    from stepdiag.daq.recording.verdicts import doubts_at, state_time

    found = standing_of(survey)
    if found.round is None:
        raise UsageError(
            str(survey),
            expected=message("recorded-survey"),
            found=message("nothing-recorded-yet"),
        )
    if stop == CODE:
        moment = _moment(begun)
        state_time(
            found.round,
            moment.timestamp(),
            reason=reason,
            name=name or getpass.getuser(),
            time_s=time.time(),
        )
        print_words(
            message(
                "first-stop-is",
                folder=str(found.round),
                moment=moment.isoformat(timespec="minutes"),
            )
        )
        return
    if begun is not None:
        raise UsageError("--begun", expected=message("accepted-code", code=CODE), found=stop)
    doubts = doubts_at(found.doubts, stop)
    note(
        doubts, found.round, reason=reason, name=name or getpass.getuser(), time_s=time.time()
    )
    taken = [message("accepted-doubt", what=each.words) for each in doubts]
    print_first(taken, FEW, verbose=verbose)
    left = [message("still-doubted", what=each.words) for each in standing_of(survey).doubts]
    print_first(left, FEW, verbose=verbose)


def _moment(text: str | None) -> "datetime":
    from datetime import UTC, datetime

    from stepdiag.base.errors import UsageError
    from stepdiag.daq.passes.survey_time import BUILT, CODE

    try:
        moment = datetime.fromisoformat(text or "").astimezone(UTC)
    except (ValueError, OverflowError):
        moment = None
    if moment is None or moment < BUILT:
        expected = message("first-stop-time", code=CODE, day=str(BUILT.date()))
        raise UsageError("--begun", expected=expected, found=text or message("nothing"))
    return moment
