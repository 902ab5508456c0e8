"""``stepdiag check``: connection to laser and machine, all signals, and their faults."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.completion import AsJson
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.base.findings import Finding
    from stepdiag.checking.check import Observation

NOT_REACHED = 4
"""Exit code for a device that cannot be reached or whose data cannot be decoded (contract 5)."""


def register(app: typer.Typer) -> None:
    app.command("check")(check)


def check(
    file: Path,
    seconds: float = 5.0,
    as_json: AsJson = False,
) -> None:
    """Show every signal of laser and PLC live, name the faults."""
    from stepdiag.checking.check import Observation
    from stepdiag.checking.diagnosis import diagnose
    from stepdiag.daq.survey.bundle import read_bundle
    from stepdiag.daq.survey.file import load_survey

    if not 1.0 <= seconds < float("inf"):
        raise UsageError(
            "--seconds",
            expected=message(
                "number-limited",
                kind=message("a-number"),
                limits=[message("limit-or-more", limit=1)],
            ),
            found=f"{seconds:g}",
        )
    survey = load_survey(file)
    read_bundle(file, survey)
    seen = Observation(survey)
    watched(seen, seconds, quiet=as_json)
    found = diagnose(seen)
    if as_json:
        _print_json(seen, found)
    else:
        show_findings(found)
    if any(each.severity == "error" for each in found):
        raise typer.Exit(NOT_REACHED)


def watched(seen: "Observation", seconds: float, *, quiet: bool) -> None:
    """Watch the links and show their table: live on a terminal, otherwise once at the end, never if
    ``quiet``. Ctrl-C ends the watch but not the check."""
    import asyncio
    import logging
    from contextlib import suppress

    import structlog
    from rich.console import Console
    from rich.live import Live

    from stepdiag.checking.check import watch
    from stepdiag.checking.tables import check_table

    # The log messages of the links would repeat the output of this command.
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    console = Console(stderr=quiet)
    if not console.is_terminal:
        with suppress(KeyboardInterrupt):
            asyncio.run(watch(seen, seconds, lambda: None))
        if not quiet:
            console.print(check_table(seen))
        return
    with (
        Live(check_table(seen), console=console, auto_refresh=False, transient=quiet) as live,
        suppress(KeyboardInterrupt),
    ):
        asyncio.run(
            watch(seen, seconds, lambda: live.update(check_table(seen), refresh=True))
        )


def show_findings(found: "tuple[Finding, ...]") -> None:
    from stepdiag.terminal.tables import finding_lines

    print_words(*finding_lines(found))
    if not any(each.severity in ("error", "warning") for each in found):
        print_words(message("all-is-well"))


def _print_json(seen: "Observation", found: "tuple[Finding, ...]") -> None:
    from stepdiag.checking.tables import check_json

    document = {**check_json(seen), "findings": [each.as_json() for each in found]}
    typer.echo(json.dumps(document, indent=2, ensure_ascii=False, default=str))
