"""``stepdiag begin``: announce the next setup to the daemon of a machine without signals."""

from pathlib import Path

import typer

from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words

ANSWER_S = 10.0
"""Longest time in s until the daemon begins the setup; the daemon reads the file of requests ten
times per second."""


def register(app: typer.Typer) -> None:
    app.command("begin")(begin)


def begin(
    survey: Path,
    setup: str,
) -> None:
    """Begin a setup of a machine without signals."""
    import getpass
    import time

    from stepdiag.base.errors import DataError, UsageError
    from stepdiag.daq.recording.begun import ask_to_begin
    from stepdiag.daq.recording.rounds import is_recording
    from stepdiag.daq.service.live import live_in
    from stepdiag.daq.survey.file import load_survey

    known = load_survey(survey)
    planned = known.plan.all_setups
    if not known.plc.silent:
        raise UsageError(
            f"{survey.name}: plc.transport",
            expected=message("transport-none"),
            found=repr(known.plc.transport),
        )
    if setup not in planned:
        raise UsageError(
            "begin", expected=message("one-of", names=planned), found=repr(setup)
        )
    folder = known.folder(survey)
    if not is_recording(folder):
        raise UsageError(
            "begin",
            expected=message("daemon-records"),
            found=message("no-recorder"),
            remedy=message("command-starts", command=f"stepdiag run {survey}"),
        )
    ask_to_begin(folder, setup, getpass.getuser())
    end = time.monotonic() + ANSWER_S
    now = live_in(folder)
    while time.monotonic() < end and (now is None or not now.awaits_stop_of(setup)):
        time.sleep(0.1)
        now = live_in(folder)
    waits = now.waits_for if now is not None else message("silence")
    if now is None or not now.awaits_stop_of(setup):
        raise DataError(
            "begin",
            expected=message("daemon-waits", setup=setup),
            found=waits,
            remedy=message("journal-says"),
        )
    print_words(message("setup-begun", setup=setup, waits=waits))
