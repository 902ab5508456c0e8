"""``stepdiag program``: the NC programs that drive a survey."""

from pathlib import Path
from typing import Annotated

import typer

from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson, programs
from stepdiag.terminal.viewer import print_words


def register(app: typer.Typer) -> None:
    app.command("program")(program)


def program(
    file: Path,
    controller: Annotated[str, typer.Option(autocompletion=programs)],
    out: Annotated[Path, typer.Option()],
    profile: Path | None = None,
    as_json: AsJson = False,
) -> None:
    """Write the NC programs that drive a survey."""
    from stepdiag.daemon.driving import programs_of
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.exporters.files.control_file import ControlFile
    from stepdiag.exporters.files.sets import write_set

    programs, beside = programs_of(load_survey(file), controller, profile)
    write_set(
        out,
        [
            *(
                ControlFile(name=each.name, data=each.data, role="program")
                for each in programs
            ),
            *beside,
        ],
    )
    written = [{"setup": each.setup, "file": str(out / each.name)} for each in programs]
    if as_json:
        import json

        typer.echo(
            json.dumps(
                {
                    "controller": controller,
                    "programs": written,
                    "beside": [str(out / each.name) for each in beside],
                },
                indent=2,
            )
        )
        return
    for each in written:
        typer.echo(f"{each['setup']:<12}{each['file']}")
    if beside:
        print_words(message("copy-for-control", names=[each.name for each in beside]))
    print_words(message("first-run"))
