"""The command line: commands by name."""

from collections.abc import Callable
from typing import Annotated

import typer

from stepdiag.cli import MODULES
from stepdiag.terminal.exits import failed_writing_shown, refusals_shown

app = typer.Typer(
    name="stepdiag",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _say_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"stepdiag {version('stepdiag')}")
        raise typer.Exit


@app.callback()
def stepdiag(
    _version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Say the version, which every log names too.")
    ] = False,
) -> None:
    """Volumetric calibration of machine tools with the laser vector (sequential step diagonal) method."""


def build() -> Callable[[], None]:
    """Return the application with every command registered."""
    from importlib import import_module

    for name in MODULES:
        import_module(f"stepdiag.cli.{name}").register(app)
    return app


def main() -> None:
    """Run a command; leave with the exit code of its cause where it is refused."""
    run = build()
    with refusals_shown(), failed_writing_shown():
        run()
