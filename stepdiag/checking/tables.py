"""The state of the links as a table: live on a terminal, otherwise once at the end."""

from typing import Any

from rich.table import Table
from rich.text import Text

from stepdiag.checking.check import LinkSeen, MachineSeen, Observation, StreamSeen

STYLES = {"connected": "green", "silent": "yellow", "lost": "red", "connecting": "yellow"}
DECIMALS = {
    "x_mm": 4,
    "y_mm": 4,
    "z_mm": 4,
    "air_pressure_hpa": 1,
    "relative_humidity_percent": 1,
}


def check_table(seen: Observation) -> Table:
    """Return a table of every link and every signal with its register, its present value and its
    number of changes."""
    table = Table(
        title=f"{seen.survey.identity.name}: {seen.survey.identity.machine}, {seen.seconds:.0f} s"
    )
    for column in ("signal", "where", "now", "changes"):
        table.add_column(
            column,
            justify="right" if column in {"now", "changes"} else "left",
            overflow="fold",
        )
    table.columns[0].no_wrap = True  # the name of a signal is copied into the survey file
    for stream in seen.streams:
        _add_stream(table, stream)
    if not seen.survey.plc.silent:
        _add_machine(table, seen.machine, seen)
    return table


def _add_link(table: Table, link: LinkSeen) -> None:
    table.add_row(
        Text(link.name, "bold"),
        Text(str(link.address)),
        Text(link.state, STYLES[link.state]),
        "",
    )


def _add_stream(table: Table, stream: StreamSeen) -> None:
    _add_link(table, stream.link)
    beam = "-" if stream.beam is None else f"{100 * stream.beam:.0f} %"
    rate = "-" if stream.rate_hz is None else f"{stream.rate_hz:.1f} / s"
    flags = ", ".join(
        flag.name.lower().replace("_", " ") for flag in stream.last_flags if flag.name
    ) or "good" * bool(stream.samples)
    table.add_row(
        "  reading",
        f"{stream.samples} samples, {rate}",
        _shown_number(stream.position_mm, 6, " mm"),
        "",
    )
    if stream.link.name != "air":
        table.add_row("  beam", Text(flags), beam, "")
    table.add_row(
        "  garbage", f"{stream.byte_count} bytes in all", str(stream.counts["garbage"]), ""
    )
    for name, value in stream.conditions.items():
        table.add_row(
            f"  {name}", "its own sensor", _shown_number(value, DECIMALS.get(name, 2)), ""
        )
    table.add_section()


def _add_machine(table: Table, machine: MachineSeen, seen: Observation) -> None:
    _add_link(table, machine.link)
    rate = "-" if machine.rate_hz is None else f"{machine.rate_hz:.0f} / s"
    table.add_row(
        "  polls",
        f"{machine.polls} answered, slowest {1e3 * machine.slowest_s:.0f} ms",
        rate,
        "",
    )
    for name in seen.survey.plc.signal_names:
        value = getattr(machine.signals, name)
        table.add_row(
            f"  {name}",
            Text(seen.survey.plc.place(name)),
            _shown_value(name, value),
            str(machine.changes[name]),
        )


def _shown_value(name: str, value: bool | float | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _shown_number(value, DECIMALS.get(name, 2))
    return "-" if value is None else str(value)


def _shown_number(value: float | None, decimals: int, unit: str = "") -> str:
    return "-" if value is None else f"{value:.{decimals}f}{unit}"


def check_json(seen: Observation) -> dict[str, Any]:
    return {
        "seconds": round(seen.seconds, 3),
        **{stream.link.name: _stream_json(stream) for stream in seen.streams},
        "machine": {
            **_link_json(seen.machine.link),
            "polls": seen.machine.polls,
            "polls_per_s": seen.machine.rate_hz,
            "slowest_s": seen.machine.slowest_s,
            "signals": {
                name: getattr(seen.machine.signals, name)
                for name in seen.survey.plc.signal_names
            },
            "changes": {
                name: seen.machine.changes[name] for name in seen.survey.plc.signal_names
            },
        },
    }


def _stream_json(stream: StreamSeen) -> dict[str, Any]:
    return {
        **_link_json(stream.link),
        "bytes": stream.byte_count,
        "samples": stream.samples,
        "samples_per_s": stream.rate_hz,
        "garbage": stream.counts["garbage"],
        "reading_mm": stream.position_mm,
        "beam": stream.beam,
        "conditions": dict(stream.conditions),
    }


def _link_json(link: LinkSeen) -> dict[str, Any]:
    return {"address": link.address, "state": link.state, "detail": link.detail}
