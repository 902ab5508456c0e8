"""``stepdiag status``: how a survey stands, from its logs alone; works beside a daemon that runs, and after one that died."""

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from stepdiag.daemon.survey_state import Standing


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("status")(status)


def status(
    path: Annotated[Path, typer.Argument(help="The survey file, or the folder of its logs.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print for programs.")] = False,
) -> None:
    """Say what of a survey is kept and what to drive again.

    And why. Nothing is changed.
    """
    from stepdiag.daemon.survey_state import standing_of

    found = standing_of(path)
    if as_json:
        typer.echo(json.dumps(_as_json(found), indent=2, ensure_ascii=False))
    else:
        _print(found)


def _as_json(found: "Standing") -> dict[str, Any]:
    from dataclasses import asdict

    import msgspec

    from stepdiag.conclusion import conclusion_in

    return {
        "survey": found.survey,
        "machine": found.machine,
        "folder": str(found.folder),
        "round": None if found.round is None else found.round.name,
        "recording": found.recording,
        "survey_file_changed": found.changed,
        "complete": found.complete,
        "result": None if found.result is None else str(found.result),
        "next_setup": found.next_setup,
        "doubts": [{"place": doubt.place, **_plain(doubt), "text": str(doubt.words)} for doubt in found.doubts],
        "unsolved": str(found.unsolved),
        "findings": [msgspec.to_builtins(each) for each in found.findings],
        "to_drive": [msgspec.to_builtins(drive) for drive in found.to_drive],
        "setups": [_plain(setup) for setup in found.setups],
        "live": _plain(found.live),
        "disk": str(found.disk),
        "logs": [asdict(log) for log in found.logs],
        "conclusion": None if found.result is None else conclusion_in(found.result.parent),
    }


def _plain(value: object) -> Any:
    """Return a struct for JSON: a message that stands where a text does is its English."""
    import msgspec

    from stepdiag.base.messages import Message

    if isinstance(value, Message):
        return str(value)
    if isinstance(value, msgspec.Struct):
        return {name: _plain(getattr(value, name)) for name in value.__struct_fields__}
    return msgspec.to_builtins(value)


def _print(found: "Standing") -> None:
    from rich.console import Console

    from stepdiag.terminal.printable import printable

    where = "nothing recorded yet" if found.round is None else str(found.round)
    daemon = "a daemon records here now" if found.recording else "no daemon runs here"
    typer.echo(printable(f"{found.survey} on {found.machine}: {where}; {daemon}"))
    Console().print(_table(found))
    for line in _live(found):
        typer.echo(printable(line))
    for setup in found.setups:
        for said in dict.fromkeys(each for each in (setup.reason, setup.doubt) if each):
            typer.echo(printable(f"{setup.name}: {said}"))
    for line in (*_undated(found), *(f"{log.name}: {log.trouble}" for log in found.logs if log.trouble)):
        typer.echo(printable(line))
    if found.disk:
        typer.echo(str(found.disk))
    if found.changed:
        words = "`stepdiag correct` shows what it changes; another volume, target list or program begins a new round"
        typer.echo(f"The survey file is not the one these logs were recorded with: {words}.")
    for line in _next(found):
        typer.echo(printable(line))
    for line in _concluded(found):
        typer.echo(line)


def _undated(found: "Standing") -> list[str]:
    """Return that the clock was never set, with the command that states the time; nothing where it was set, or the time is stated."""
    from stepdiag.daq.passes.survey_time import CODE

    where = shlex.quote(str(found.round or found.folder))
    unset = [str(each.finding.words) for each in found.findings if (each.code, each.severity) == (CODE, "warning")]
    return [f"{text}: `stepdiag accept {where} {CODE} --begun TIME --reason ...`" for text in unset]


def _concluded(found: "Standing") -> list[str]:
    return [] if found.result is None else concluded_in(found.result.parent)


def concluded_in(folder: Path) -> list[str]:
    """Return the conclusion that stands in a survey's folder, as lines; none before there is one."""
    from stepdiag.conclusion import conclusion_in, titles_of, words_of
    from stepdiag.terminal.tables import conclusion_lines

    document = conclusion_in(folder)
    return [] if document is None else list(conclusion_lines(words_of(document, "en"), titles_of("en")))


def _table(found: "Standing") -> "Table":
    from rich.table import Table

    table = Table()
    for column in ("setup", "passes", "stops", "state"):
        table.add_column(column, justify="right" if column in {"passes", "stops"} else "left")
    for setup in found.setups:
        passes, stops = f"{setup.passes_done} of {setup.passes_wanted}", f"{setup.stops_done} of {setup.stops_wanted}"
        table.add_row(setup.name, passes, stops, setup.state)
    return table


def _live(found: "Standing") -> list[str]:
    """Return what the daemon hears and waits for, as lines; none where none runs."""
    if found.live is None:
        return []
    links = {"laser": found.live.laser, "machine": found.live.plc, "head": found.live.head, "air": found.live.air}
    lines = [f"{name}: {link.state} ({link.detail or link.address})" for name, link in links.items() if link is not None]
    air = ", ".join(f"{name} {value:g}" for name, value in found.live.told.items())
    lines += [f"told of air and material: {air}"] if air else []
    return [*lines, f"it waits for: {found.live.waits_for}", *([str(found.live.message)] if found.live.message else [])]


def _doubted(found: "Standing") -> list[str]:
    """Return every doubt in its words, unless a setup's line holds them, and after those of a place the command that accepts them."""
    from stepdiag.daq.passes.doubt import places_of

    where = shlex.quote(str(found.round or found.folder))
    said, lines = " ".join(str(setup.doubt) for setup in found.setups), list[str]()
    for place in places_of(found.doubts):
        here = [str(doubt.words) for doubt in found.doubts if doubt.place == place]
        lines += [text for text in here if text not in said and text not in lines]
        lines.append(f"accept what is known to be right: `stepdiag accept {where} {place} --reason ...`")
    return lines


def _still(found: "Standing") -> list[str]:
    """Return what is still to be driven, in order, a line a pass."""
    total = sum(drive.minutes for drive in found.to_drive)
    lines = [f"still to drive, about {max(round(total), 1)} min with setting up:"]
    for drive in found.to_drive:
        place = f"from stop {drive.from_stop} on, {drive.stops} stops" if drive.from_stop else f"{drive.stops} stops"
        lines.append(f"  {drive.setup}, pass {drive.pass_number}: {place}, about {max(round(drive.minutes), 1)} min")
    return lines


def _next(found: "Standing") -> list[str]:
    """Return what to do next."""
    from stepdiag.daq.records.survey_folder import RESULT

    if not found.complete:
        return [f"next: {found.next_setup}", *_still(found), *_doubted(found)]
    if found.result is not None:
        return [f"complete: {found.result}"]
    if found.unsolved:
        return [f"every pass is in, and there is no result: {found.unsolved}"]
    logs = found.round or found.folder
    command = shlex.join(["stepdiag", "solve", str(logs), "--out", str(logs / RESULT)])
    return [f"every pass is in, no result yet: `{command}` makes one"]
