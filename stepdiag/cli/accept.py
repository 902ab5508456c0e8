"""``stepdiag accept``: a person's word that what is doubted of a survey may be used all the same."""

from pathlib import Path
from typing import Annotated

import typer


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
) -> None:
    """Accept a stop that is doubted.

    It is recorded beside the logs with name and time and stands in the report. `status` names what is doubted. A daemon that runs hears of
    it at once.
    """
    import getpass
    import time

    from stepdiag.base.errors import UsageError
    from stepdiag.daemon.survey_state import standing_of
    from stepdiag.daq.recording.verdicts import accept as note
    from stepdiag.daq.recording.verdicts import doubts_at
    from stepdiag.terminal.printable import printable

    found = standing_of(survey)
    if found.round is None:
        raise UsageError(str(survey), expected="a survey that was recorded", found="nothing recorded yet")
    doubts = doubts_at(found.doubts, stop)
    note(doubts, found.round, reason=reason, name=name or getpass.getuser(), time_s=time.time())
    for doubt in doubts:
        typer.echo(printable(f"accepted: {doubt.place}: {doubt.text}"))
    for left in standing_of(survey).doubts:
        typer.echo(printable(f"still doubted: {left.place}: {left.text}"))
