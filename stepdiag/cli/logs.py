"""``stepdiag info``, ``recover`` and ``decode``: the contents of a log, repair of a truncated log,
and every sample of a log."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, message
from stepdiag.cli.completion import STREAMS, AsJson, decoded_formats, streams
from stepdiag.terminal.printable import printable
from stepdiag.terminal.viewer import print_words, shown

if TYPE_CHECKING:
    from collections.abc import Callable

    from stepdiag.daq.log.recovery import LogInfo, Recovery
    from stepdiag.daq.records.events import Stream

_LONG = 60


def register(app: typer.Typer) -> None:
    app.command("info")(info)
    app.command("recover")(recover)
    app.command("decode")(decode)


def info(log: Path, as_json: AsJson = False) -> None:
    """Print the contents of a log, and whether the log is complete."""
    from stepdiag.daq.log.contents import must_be_there
    from stepdiag.daq.log.recovery import log_info

    must_be_there(log)
    found = log_info(log)
    if as_json:
        typer.echo(json.dumps(_as_json(found), indent=2, ensure_ascii=False))
    else:
        print_words(_as_text(found))


def recover(
    log: Path,
    out: Annotated[Path | None, typer.Option("--out")] = None,
    as_json: AsJson = False,
) -> None:
    """Mend a log that was cut off, into a new file."""
    from stepdiag.daq.log.contents import must_be_there
    from stepdiag.daq.log.recovery import recover as mend

    must_be_there(log)
    done = mend(log, out)
    if as_json:
        typer.echo(json.dumps(_recovery_json(done), indent=2, ensure_ascii=False))
    else:
        print_words(_recovery_text(done))


def decode(
    log: Path,
    to: Annotated[str, typer.Option(autocompletion=decoded_formats)] = "csv",
    out: Annotated[Path | None, typer.Option("--out")] = None,
    stream: Annotated[str, typer.Option(autocompletion=streams)] = "laser",
    survey: Annotated[Path | None, typer.Option("--survey")] = None,
) -> None:
    """Write every sample of a log at full rate."""
    from stepdiag.daq.log.contents import must_be_there, open_log
    from stepdiag.daq.log.decoded import decoded
    from stepdiag.daq.log.decoded_files import FORMATS
    from stepdiag.terminal.progress import working

    if stream not in STREAMS:
        raise UsageError("--stream", expected=" or ".join(STREAMS), found=stream)
    if to not in FORMATS:
        raise UsageError("--to", expected=", ".join(FORMATS), found=to)
    must_be_there(log)
    target = out or log.with_name(f"{log.name.partition('.')[0]}-{stream}.{to}")
    if target.exists():
        raise UsageError(
            str(target),
            expected=message("new-file"),
            found=message("one-exists"),
            remedy=message("name-with-out"),
        )
    source, chosen = open_log(log), cast("Stream", stream)
    with working(message("decoding")):
        count = _written(
            target,
            lambda part: FORMATS[to](part, source, chosen, decoded(source, chosen, survey)),
        )
    print_words(message("decoded-samples", path=str(target), count=count, stream=stream))


def _written(target: Path, write: "Callable[[Path], int]") -> int:
    from stepdiag.base.disk.part import part_of, publish_new

    with part_of(target) as folder:
        count = write(folder / target.name)
        publish_new(folder / target.name, target)
    return count


def _as_json(found: "LogInfo") -> dict[str, object]:
    return {
        "path": str(found.path),
        "begin": _wall(found.begin_wall_ns),
        "seconds": round(found.seconds, 6),
        "whole": found.end.whole,
        "damage": str(found.end.damage),
        "lost_bytes": found.end.lost_bytes,
        "dropped_events": found.end.dropped_events,
        "events": found.end.events,
        "stops": found.stops,
        "polls": found.polls,
        "stream_bytes": found.stream_bytes,
        "messages": found.end.messages,
        "run": found.run,
        "clock": found.clock,
        "run_stop": found.end.run_stop,
        "carries_token": found.carries_token,
    }


def _as_text(found: "LogInfo") -> str:
    end = found.end
    streams = [
        message("bytes-of", count=count, stream=stream)
        for stream, count in found.stream_bytes.items()
    ]
    state = (
        message("log-whole", how=end.run_stop["exit_status"]) if end.whole else _damage(found)
    )
    reason = f": {end.run_stop['reason']}" if end.run_stop.get("reason") else ""
    facts = [
        message("log-lasted", begin=_wall(found.begin_wall_ns), seconds=found.seconds),
        message(
            "log-holds",
            stops=found.stops,
            polls=found.polls,
            streams=streams or [message("nothing")],
        ),
    ]
    if "recovered_from" in end.run_stop:
        facts.insert(0, message("mended-from", name=end.run_stop["recovered_from"]))
    if found.carries_token:
        facts.append(message("carries-token"))
    lines = [
        f"{found.path}: {shown(state)}{reason}",
        *(f"  {shown(fact)}" for fact in facts),
        *(
            f"  {topic:<16} {count:>8} messages"
            for topic, count in sorted(end.messages.items())
        ),
        *(f"  {name}: {_short(text)}" for name, text in (found.run | found.clock).items()),
    ]
    return printable("\n".join(lines))


def _short(text: str) -> str:
    shown = printable(text[:_LONG]).replace("\n", "?")
    return shown if len(text) <= _LONG else f"{shown}... ({len(text)} characters)"


def _damage(found: "LogInfo") -> Message:
    end = found.end
    return message(
        "log-not-whole",
        why=end.damage or message("not-closed"),
        lost=end.lost_bytes,
        dropped=end.dropped_events,
    )


def _recovery_json(done: "Recovery") -> dict[str, object]:
    return {
        "source": str(done.source),
        "target": str(done.target),
        "messages": done.messages,
        "events": done.end.events,
        "damage": str(done.end.damage),
        "lost_bytes": done.end.lost_bytes,
        "dropped_events": done.end.dropped_events,
    }


def _recovery_text(done: "Recovery") -> str:
    end = done.end
    kept = message(
        "log-mended", path=str(done.target), events=end.events, messages=done.messages
    )
    lost = message(
        "log-lost",
        path=str(done.source),
        why=end.damage,
        lost=end.lost_bytes,
        dropped=end.dropped_events,
    )
    return f"{shown(kept)}\n  {shown(lost)}"


def _wall(wall_ns: int) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(wall_ns / 1e9, UTC).isoformat(timespec="milliseconds")
