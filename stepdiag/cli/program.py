"""``stepdiag program``: the NC programs that drive a survey."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.cli.completion import PROGRAMS, programs


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("program")(program)


def program(
    file: Annotated[Path, typer.Argument(help="The survey file (TOML).")],
    controller: Annotated[str, typer.Option(help=f"The control: {', '.join(PROGRAMS)}.", autocompletion=programs)],
    out: Annotated[
        Path, typer.Option(help="The folder to write, whole or not at all; what is there is never overwritten with other bytes.")
    ],
    profile: Annotated[Path | None, typer.Option(help="The machine's profile, for its section [program].")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print for programs.")] = False,
) -> None:
    """Write the NC programs that drive a survey.

    One for each setup, with stops, dwells and the signals to the PLC; for LinuxCNC also the HAL component that serves them over Modbus.
    """
    from stepdiag.daemon.driving import programs_of
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    programs, beside = programs_of(load_survey(file), controller, profile)
    write_set(out, [*(ControlFile(name=each.name, data=each.data, role="program") for each in programs), *beside])
    written = [{"setup": each.setup, "file": str(out / each.name)} for each in programs]
    if as_json:
        import json

        typer.echo(
            json.dumps({"controller": controller, "programs": written, "beside": [str(out / each.name) for each in beside]}, indent=2)
        )
        return
    for each in written:
        typer.echo(f"{each['setup']:<12}{each['file']}")
    if beside:
        typer.echo(f"for the control: {', '.join(each.name for each in beside)}: copy both beside its INI file and add the HALFILE")
    typer.echo("First run of each program: single block, feed override low, hand on feed hold. Each begins with what the PLC must offer.")
