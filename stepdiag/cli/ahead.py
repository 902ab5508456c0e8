"""``stepdiag next``: the next setup of a survey, or the end of the survey."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson
from stepdiag.terminal.viewer import wrapped


def register(app: typer.Typer) -> None:
    app.command("next")(next_setup)


def next_setup(
    file: Path,
    take: Annotated[bool, typer.Option("--take")] = False,
    note: Annotated[bool, typer.Option("--note", hidden=True)] = False,
    as_json: AsJson = False,
) -> None:
    """Show which setup to drive next."""
    from stepdiag.daq.service.priority import lower_priority

    if note:
        lower_priority()
    import json

    from stepdiag.base.messages import kept
    from stepdiag.completion.ahead import in_words, look_ahead
    from stepdiag.completion.ahead import take as put
    from stepdiag.daq.service.ahead import write_ahead
    from stepdiag.terminal.exits import refusals_shown

    with refusals_shown(kept if note else wrapped):
        survey, folder, ahead = look_ahead(file)
        status = in_words(ahead, survey)
        if note and folder is not None:
            write_ahead(folder, status)
        if take:
            run = put(file, survey, ahead)
            programs = _programs(file, run.setup)
            taken = message("ahead-taken", setup=run.setup, programs=programs)
            typer.echo(kept(taken) if note else wrapped(taken), err=True)
            return
    if as_json:
        figures = {
            "now_um": ahead.now_um,
            "then_um": ahead.then_um,
            "minutes": ahead.minutes,
            "at_most_um": ahead.at_most_um,
        }
        typer.echo(
            json.dumps(
                {
                    "end": ahead.end,
                    "setup": status.setup,
                    "further": status.further,
                    "runs": [
                        {"setup": run.setup, "beam_offset_mm": run.beam_offset_mm}
                        for run in ahead.runs
                    ],
                    "angles_urad": ahead.angles_urad,
                    **figures,
                    "text": str(status.words),
                },
                indent=2,
                ensure_ascii=False,
            )
        )
    elif not note:
        typer.echo(wrapped(status.words))


def _programs(file: Path, setup: str) -> list[str]:
    from stepdiag.daemon.driving import programs_of
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set
    from stepdiag.exporters.programs import CONTROLS

    survey, written = load_survey(file), []
    for each in survey.exports:
        if each.controller in CONTROLS:
            profile = file.parent / each.profile
            programs, _ = programs_of(
                survey, each.controller, profile if profile.exists() else None
            )
            own = [
                ControlFile(name=one.name, data=one.data, role="program")
                for one in programs
                if one.setup == setup
            ]
            folder = file.parent / "programs" / setup / each.controller
            write_set(folder, own)
            written += [str(folder / one.name) for one in own]
    return written
