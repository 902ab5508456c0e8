"""``stepdiag init``: a first survey file with comments."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.cli.questions import machine_class_asked
from stepdiag.terminal.viewer import print_words


def register(app: typer.Typer) -> None:
    app.command("init")(init)


def init(
    file: Annotated[Path, typer.Argument()] = Path("survey.toml"),
    machine_class: str | None = None,
    feedback: str | None = None,
    pitch_mm: str | None = None,
) -> None:
    """Write a commented survey file; an existing file is never overwritten."""
    from stepdiag.base.files import refuse_existing, write_new
    from stepdiag.daq.survey.composed import begun

    refuse_existing(file)
    write_new(file, begun(machine_class_asked(machine_class, feedback, pitch_mm), file.name))
    print_words(message("survey-written", path=str(file)))
