"""``stepdiag accept``: a person's word that what is doubted of a survey may be used all the same."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from datetime import datetime


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("accept")(accept)


def accept(
    survey: Annotated[Path, typer.Argument(help="The survey file, or the folder of its logs.")],
    stop: Annotated[
        str,
        typer.Argument(help="What is doubted: ppp/1/5 is stop 5 of pass 1 of ppp, ppp/1 the whole pass, a finding's code all of its kind."),
    ],
    reason: Annotated[str, typer.Option(help="Why it may be used; it stands in the report.")],
    name: Annotated[str, typer.Option(help="Who says so; default the user of this computer.")] = "",
    begun: Annotated[
        str | None, typer.Option(help="With clock-unset: when the first stop was captured, such as 2026-11-26T08:10 (local time).")
    ] = None,
) -> None:
    """Accept what is doubted, or state the time of a survey.

    It is recorded beside the logs with name and time and stands in the report. `status` names what is doubted, and a clock
    that was never set. A daemon that runs hears of it at once.
    """
    import getpass
    import time

    from stepdiag.base.errors import UsageError
    from stepdiag.base.messages import message
    from stepdiag.daemon.survey_state import standing_of
    from stepdiag.daq.passes.survey_time import CODE
    from stepdiag.daq.recording.verdicts import accept as note
    from stepdiag.daq.recording.verdicts import doubts_at, state_time
    from stepdiag.terminal.viewer import shown

    found = standing_of(survey)
    if found.round is None:
        raise UsageError(str(survey), expected="a survey that was recorded", found="nothing recorded yet")
    if stop == CODE:
        moment = _moment(begun)
        state_time(found.round, moment.timestamp(), reason=reason, name=name or getpass.getuser(), time_s=time.time())
        typer.echo(f"the first stop of {found.round} is of {moment.isoformat(timespec='minutes')}")
        return
    if begun is not None:
        raise UsageError("--begun", expected=f"{CODE} as what is accepted", found=stop)
    doubts = doubts_at(found.doubts, stop)
    note(doubts, found.round, reason=reason, name=name or getpass.getuser(), time_s=time.time())
    for doubt in doubts:
        typer.echo(shown(message("accepted-doubt", place=doubt.place, what=doubt.words)))
    for left in standing_of(survey).doubts:
        typer.echo(shown(message("still-doubted", place=left.place, what=left.words)))


def _moment(text: str | None) -> "datetime":
    """Return the time that a person states, in UTC. Raises UsageError for none, and for one before this program was built."""
    from datetime import UTC, datetime

    from stepdiag.base.errors import UsageError
    from stepdiag.daq.passes.survey_time import BUILT, CODE

    try:
        moment = datetime.fromisoformat(text or "").astimezone(UTC)
    except (ValueError, OverflowError):
        moment = None
    if moment is None or moment < BUILT:
        expected = f"with {CODE} the time of the first stop, such as 2026-11-26T08:10, from {BUILT.date()} on"
        raise UsageError("--begun", expected=expected, found=text or "nothing")
    return moment
