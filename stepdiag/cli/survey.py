"""``stepdiag init``: a survey file to start from."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("init")(init)


def init(file: Annotated[Path, typer.Argument(help="The survey file to write.")] = Path("survey.toml")) -> None:
    """Write a commented survey file; never over an existing one."""
    from stepdiag.daq.survey.template import template
    from stepdiag.exporters.files.files import write_new

    write_new(file, template())
    typer.echo(f"{file} written: fill in [volume], [laser] and [plc], then run `stepdiag check {file}`")
