"""The command line as a person meets it, without a process for each test: same refusals, same exit
codes."""

import re
import shutil
import socket
import sys
from functools import cache
from typing import NamedTuple

import typer.main
import typer.testing

from stepdiag.base.errors import StepdiagError
from stepdiag.cli.app import app, build
from stepdiag.daq.service import priority
from stepdiag.terminal.exits import EXIT_CODES
from stepdiag.terminal.viewer import WHOLE, WIDEST


class Told(NamedTuple):
    """How a command ended: exit code, standard output with its wrapped lines joined, and the
    refusal it ended with (empty where there was none)."""

    code: int
    out: str
    refusal: str


# the runner builds all commands anew for each call, which costs more than most calls: a command
# keeps nothing of a call
vars(typer.testing)["_get_command"] = cache(typer.main.get_command)
# what a command of the recorder does to its process would stay on that of the tests: less
# important, and on one processor
vars(priority)["lower_priority"] = lambda: None


@cache
def _built() -> None:
    build()


_LISTENING = ("run", "publish", "fleet", "demo", "setup")
"""Commands that serve by purpose, and those that play a machine:
`tests/system/service/test_listening.py` lists their ports."""
_watched: list[str] = []


@cache
def _audited() -> None:
    sys.addaudithook(_refuse_port)


def _refuse_port(event: str, arguments: tuple[object, ...]) -> None:
    """Raise AssertionError where a command binds a port of the network: whoever has an account of
    the computer could connect."""
    if event == "socket.bind" and _watched and _watched[-1] not in _LISTENING:
        family = getattr(arguments[0], "family", None)
        if family in (socket.AF_INET, socket.AF_INET6):
            raise AssertionError(f"`stepdiag {_watched[-1]}` listens on {arguments[1]}")


def stepdiag(*arguments: object) -> Told:
    """Run ``stepdiag`` with these arguments; a command that works on files may not bind a port."""
    _built()
    _audited()
    _watched.append(str(arguments[0]) if arguments else "")
    try:
        result = typer.testing.CliRunner().invoke(
            app, [str(argument) for argument in arguments]
        )
    finally:
        _watched.pop()
    if isinstance(result.exception, StepdiagError):
        code = next(
            code for cause, code in EXIT_CODES.items() if isinstance(result.exception, cause)
        )
        return Told(code, joined(result.stdout), str(result.exception))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Told(result.exit_code, joined(result.stdout), joined(result.stderr))


def joined(text: str) -> str:
    """Return an output whose wrapped lines are whole again: a line goes on in the next one where
    that one stands two columns to the right and its first word had no room in the first."""
    columns = min(shutil.get_terminal_size().columns, WIDEST)
    lines: list[str] = []
    last, indent = "", 0
    for line in text.split("\n"):
        words = line.lstrip(" ")
        first = re.match(rf"(?:{WHOLE.pattern}|[^\s`])*", words)
        room = len(last) + 1 + len(first[0] if first else "")
        if lines and words and len(line) - len(words) == indent + 2 and room > columns:
            lines[-1] += f" {words}"
        else:
            lines.append(line)
            indent = len(line) - len(words)
        last = line
    return "\n".join(lines)
