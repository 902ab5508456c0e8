"""``stepdiag status``: the state of a survey, read from its logs. The command works during and
after the recording."""

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from stepdiag.base.messages import Message, Words, message
from stepdiag.cli.completion import AsJson, Verbose
from stepdiag.terminal.viewer import empty_table, print_first, print_words, shown

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.table import Table

    from stepdiag.daemon.survey_state import Standing
    from stepdiag.daq.records.status import SetupStatus

FEW_REMARKS, FEW_DOUBTS = 6, 4
"""Number of lines for remarks, and for doubts, without ``--verbose``: with a table of seven setups
the output then fits a screen of 30 lines."""
ANSWER = ("reached", "verdict", "load", "next_step")
"""Sections of the conclusion that are printed without ``--verbose``."""
_STATES = {
    "to-do": message("state-to-do"),
    "running": message("state-running"),
    "done": message("state-done"),
    "again": message("state-again"),
}
_LINKS = {
    "connecting": message("link-connecting"),
    "connected": message("link-connected"),
    "silent": message("link-silent"),
    "lost": message("link-gone"),
}


def register(app: typer.Typer) -> None:
    app.command("status")(status)


def status(
    path: Path,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> None:
    """Print which parts of a survey are kept, and which passes must be driven again."""
    from stepdiag.daemon.survey_state import standing_of

    found = standing_of(path)
    if as_json:
        typer.echo(json.dumps(_as_json(found), indent=2, ensure_ascii=False))
    else:
        _print(found, verbose=verbose)


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
        "doubts": [
            {"place": doubt.place, **_plain(doubt), "text": str(doubt.words)}
            for doubt in found.doubts
        ],
        "unsolved": str(found.unsolved),
        "findings": [msgspec.to_builtins(each) for each in found.findings],
        "to_drive": [msgspec.to_builtins(drive) for drive in found.to_drive],
        "setups": [_plain(setup) for setup in found.setups],
        "ahead": {
            "setup": found.ahead.setup,
            "further": found.ahead.further,
            "text": str(found.ahead.words),
        },
        "live": _plain(found.live),
        "disk": str(found.disk),
        "logs": [asdict(log) | {"trouble": str(log.trouble)} for log in found.logs],
        "conclusion": None if found.result is None else conclusion_in(found.result.parent),
    }


def _plain(value: object) -> Any:
    import msgspec

    if isinstance(value, Message):
        return str(value)
    if isinstance(value, msgspec.Struct):
        return {name: _plain(getattr(value, name)) for name in value.__struct_fields__}
    return msgspec.to_builtins(value)


def _print(found: "Standing", *, verbose: bool) -> None:
    from rich.console import Console

    where = message("nothing-recorded-yet") if found.round is None else str(found.round)
    recorder = message("recorder-records") if found.recording else message("no-recorder")
    print_words(
        message(
            "status-survey",
            survey=found.survey,
            machine=found.machine,
            where=where,
            recorder=recorder,
        )
    )
    print_words(*_next(found))
    if not found.complete and not found.wrong_line:
        print_words(*(_still(found) if verbose else _still(found)[:1]))
    print_words(*_concluded(found, verbose=verbose))
    setups = [each for each in found.setups if verbose or each.state != "done"]
    if setups:
        Console().print(_setup_table(setups))
    print_first(list(_remarks(found)), FEW_REMARKS, verbose=verbose)
    if not found.complete and not found.wrong_line:
        print_first(_doubted(found), FEW_DOUBTS, verbose=verbose)
    print_words(*_live(found, verbose=verbose), *_ahead(found))


def _remarks(found: "Standing") -> "Iterator[Words]":
    for setup in found.setups:
        for words in dict.fromkeys(each for each in (setup.reason, setup.doubt) if each):
            yield message("labelled", name=_named(setup.name), what=words)
    yield from _undated(found)
    yield from (
        message("labelled", name=log.name, what=log.trouble)
        for log in found.logs
        if log.trouble
    )
    if found.disk:
        yield found.disk
    yield from (message("status-corrected", what=line) for line in found.corrections)
    if found.changed:
        yield message("survey-file-changed")


def _ahead(found: "Standing") -> "list[Words]":
    return [message("status-ahead", what=found.ahead.words)] if found.ahead.words else []


def _undated(found: "Standing") -> "list[Words]":
    from stepdiag.daq.passes.survey_time import CODE

    where = shlex.quote(str(found.round or found.folder))
    unset = [
        each.finding.words
        for each in found.findings
        if (each.code, each.severity) == (CODE, "warning")
    ]
    return [
        message(
            "labelled",
            name=words,
            what=f"`stepdiag accept {where} {CODE} --begun TIME --reason ...`",
        )
        for words in unset
    ]


def _concluded(found: "Standing", *, verbose: bool) -> list[str]:
    return [] if found.result is None else concluded_in(found.result.parent, verbose=verbose)


def concluded_in(folder: Path, *, verbose: bool = True) -> list[str]:
    """Return the conclusion in a survey's folder as lines, empty if no conclusion exists. Without
    ``verbose``, return only the sections in `ANSWER`."""
    from stepdiag.cli.solve import in_lines
    from stepdiag.conclusion import conclusion_in

    document = conclusion_in(folder)
    if document is None:
        return []
    return in_lines({name: document[name] for name in document if verbose or name in ANSWER})


def _setup_table(setups: "Sequence[SetupStatus]") -> "Table":
    table = empty_table(message("table-status"))
    for setup in setups:
        passes = message("so-many-of", done=setup.passes_done, wanted=setup.passes_wanted)
        stops = message("so-many-of", done=setup.stops_done, wanted=setup.stops_wanted)
        table.add_row(
            shown(_named(setup.name)),
            shown(passes),
            shown(stops),
            shown(_STATES[setup.state]),
        )
    return table


def _named(setup: str) -> Message:
    return message("setup-named", setup=setup)


def _live(found: "Standing", *, verbose: bool) -> "list[Words]":
    if found.live is None:
        return []
    links = {
        message("link-laser"): found.live.laser,
        message("link-machine"): found.live.plc,
        message("link-head"): found.live.head,
        message("link-air"): found.live.air,
    }
    lines: list[Words] = [
        message(
            "status-link",
            name=name,
            state=_LINKS[link.state],
            detail=link.detail or link.address,
        )
        for name, link in links.items()
        if link is not None and (verbose or link.state != "connected")
    ]
    air = ", ".join(f"{name} {value:g}" for name, value in found.live.conditions.items())
    lines += [message("status-air", values=air)] if air and verbose else []
    return [
        *lines,
        message("status-waits", what=found.live.waits_for),
        *([found.live.message] if found.live.message else []),
    ]


def _doubted(found: "Standing") -> "list[Words]":
    from stepdiag.daq.passes.doubt import places_of

    where = shlex.quote(str(found.round or found.folder))
    named, lines = " ".join(str(setup.doubt) for setup in found.setups), list["Words"]()
    for place in places_of(found.doubts):
        here = [doubt.words for doubt in found.doubts if doubt.place == place]
        lines += [
            words
            for words in dict.fromkeys(here)
            if str(words) not in named and words not in lines
        ]
        lines.append(
            message("status-accept", command=f"stepdiag accept {where} {place} --reason ...")
        )
    return lines


def _still(found: "Standing") -> "list[Words]":
    total = sum(drive.minutes for drive in found.to_drive)
    lines: list[Words] = [message("status-to-drive", minutes=max(round(total), 1))]
    for drive in found.to_drive:
        stops = message("stops-counted", count=drive.stops)
        if drive.from_stop:
            stops = message("stops-from", first=drive.from_stop, count=drive.stops)
        minutes = max(round(drive.minutes), 1)
        line = message(
            "status-pass",
            setup=drive.setup,
            number=drive.pass_number,
            stops=stops,
            minutes=minutes,
        )
        lines.append(f"  {shown(line)}")
    return lines


def _next(found: "Standing") -> "list[Words]":
    from stepdiag.daq.records.survey_folder import RESULT

    if found.wrong_line:
        return [message("status-correct", line=found.wrong_line)]
    if not found.complete:
        return [message("status-next", what=found.next_setup)]
    if found.result is not None:
        return [message("status-complete", path=str(found.result))]
    if found.unsolved:
        return [message("status-unsolved", why=found.unsolved)]
    logs = found.round or found.folder
    command = shlex.join(["stepdiag", "solve", str(logs), "--out", str(logs / RESULT)])
    return [message("status-unasked", command=command)]
