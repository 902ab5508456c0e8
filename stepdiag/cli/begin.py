"""``stepdiag begin``: tell the daemon of a machine without signals which setup is going to be driven now."""

from pathlib import Path
from typing import Annotated

import typer

ANSWER_S = 10.0
"""How long the daemon may take to begin: it looks ten times a second."""


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("begin")(begin)


def begin(
    survey: Annotated[Path, typer.Argument(help="The survey file (TOML).")],
    setup: Annotated[str, typer.Argument(help="The setup that the machine is going to drive: ppp, npp, linear-x ...")],
) -> None:
    """Begin a setup of a machine without signals.

    For plc.transport = "none", before its NC program is started: from here on the laser's plateaus are taken for the stops of this setup. A
    machine with signals says so itself.
    """
    import getpass
    import time

    from stepdiag.base.errors import DataError, UsageError
    from stepdiag.daq.recording.begun import ask_to_begin
    from stepdiag.daq.recording.rounds import is_recording
    from stepdiag.daq.service.live import live_in
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.terminal.printable import printable

    known = load_survey(survey)
    planned = known.plan.all_setups
    if not known.plc.silent:
        raise UsageError(f"{survey.name}: plc.transport", expected='"none", to begin a setup by hand', found=repr(known.plc.transport))
    if setup not in planned:
        raise UsageError("begin", expected=f"one of {', '.join(planned)}", found=repr(setup))
    folder = known.folder(survey)
    if not is_recording(folder):
        raise UsageError("begin", expected="a daemon that records", found="none", remedy=f"start it with `stepdiag run {survey}`")
    ask_to_begin(folder, setup, getpass.getuser())
    end = time.monotonic() + ANSWER_S
    now = live_in(folder)
    while time.monotonic() < end and (now is None or not now.awaits_stop_of(setup)):
        time.sleep(0.1)
        now = live_in(folder)
    waits = str(now.waits_for) if now is not None else "nothing is heard of it"
    if now is None or not now.awaits_stop_of(setup):
        raise DataError("begin", expected=f"a daemon that waits for the stops of {setup}", found=waits, remedy="its journal says why")
    typer.echo(printable(f"{setup} is begun: start its NC program now ({waits})"))
