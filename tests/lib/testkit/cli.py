"""The command line as a person meets it, without a process for each test: same refusals, same exit codes."""

from functools import cache
from typing import NamedTuple

import typer.main
import typer.testing

from stepdiag.base.errors import StepdiagError
from stepdiag.cli.app import app, build
from stepdiag.terminal.exits import EXIT_CODES


class Told(NamedTuple):
    """How a command ended: exit code, standard output, and the refusal it ended with (empty where there was none)."""

    code: int
    out: str
    refusal: str


# the runner builds all commands anew for each call, which costs more than most calls: a command keeps nothing of a call
vars(typer.testing)["_get_command"] = cache(typer.main.get_command)


@cache
def _built() -> None:
    build()


def stepdiag(*arguments: object) -> Told:
    """Run ``stepdiag`` with these arguments."""
    _built()
    result = typer.testing.CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(result.exception, StepdiagError):
        code = next(code for cause, code in EXIT_CODES.items() if isinstance(result.exception, cause))
        return Told(code, result.stdout, str(result.exception))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Told(result.exit_code, result.stdout, result.stderr)
