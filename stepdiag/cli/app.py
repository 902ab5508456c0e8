"""The application of the command line with all its commands."""

import sys
from collections.abc import Callable
from functools import partial, wraps
from typing import Annotated

import typer

from stepdiag.base.disk.system import LINUX
from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli import LINUX_ONLY, MODULES
from stepdiag.cli.helped import HelpedGroup
from stepdiag.terminal.exits import failed_writing_shown, refusals_shown
from stepdiag.terminal.viewer import wrapped

app = typer.Typer(
    name="stepdiag",
    cls=HelpedGroup,
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
        bool, typer.Option("--version", callback=_say_version, is_eager=True)
    ] = False,
) -> None:
    """Volumetric calibration of machine tools with the laser vector (sequential step diagonal)
    method."""


def build() -> Callable[[], None]:
    from importlib import import_module

    for name in MODULES:
        import_module(f"stepdiag.cli.{name}").register(app)
    if not LINUX:
        _refuse_elsewhere(app)
    return app


def _refuse_elsewhere(group: typer.Typer, before: str = "") -> None:
    for command in group.registered_commands:
        name = before + str(command.name or getattr(command.callback, "__name__", ""))
        if name in LINUX_ONLY and command.callback:
            command.callback = wraps(command.callback)(partial(_refuse, name))
    for inner in group.registered_groups:
        if inner.typer_instance:
            _refuse_elsewhere(
                inner.typer_instance, f"{inner.name or inner.typer_instance.info.name} "
            )


def _refuse(name: str, **_arguments: object) -> None:
    raise UsageError(
        f"stepdiag {name}",
        expected="Linux",
        found=sys.platform,
        remedy=message("other-systems"),
    )


def main() -> None:
    """Run a command; after an error, exit with the code of the error's cause."""
    run = build()
    with refusals_shown(wrapped), failed_writing_shown():
        run()
