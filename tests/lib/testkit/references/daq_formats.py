"""The rooms of daq/formats, played from an input as it stands in a reference file.

Bytes stand there as text, a character a byte, as ``{"hex": ...}``, or as ``{"hex": ..., "times":
...}`` where they repeat.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.daq.formats.expressions import Memory, parse_expression
from stepdiag.daq.formats.framing.checksums import CHECKSUMS, Crc, checksum
from stepdiag.daq.formats.framing.counter import CounterTrack, Wrap
from stepdiag.daq.formats.framing.frames import FrameBuffer, Junk
from stepdiag.daq.formats.framing.layout import read_layout
from stepdiag.daq.formats.framing.lines import LineBuffer, quote
from stepdiag.daq.formats.framing.units import mm_per_unit
from stepdiag.daq.formats.instruments import (
    air,
    angles,
    fourdof,
    framed,
    ids3010,
    lasertex,
    line,
    nd,
    qudis,
    tqd,
)
from stepdiag.daq.formats.instruments.umd import decoder as umd
from stepdiag.daq.formats.instruments.umd.board import Board
from stepdiag.daq.formats.instruments.umd.reading import Reading
from stepdiag.daq.formats.instruments.umd.rows import OddLine, parse_lines, uniform_rows
from stepdiag.daq.formats.recognise import recognise, refused, senseless
from stepdiag.daq.formats.registry import make_decoder
from stepdiag.daq.formats.signals import (
    CONTRACT_SIGNALS,
    SignalDecoder,
    SignalSpec,
    describe,
    plan_reads,
    registers,
    resolution,
)
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.timing.samples import Samples
from testkit.references import plain

SETTINGS: dict[str, Callable[..., Any]] = {
    "air": air.AirSettings,
    "angles": angles.AnglesSettings,
    "fourdof": fourdof.FourdofSettings,
    "frames": framed.FramesSettings,
    "ids3010": ids3010.Ids3010Settings,
    "lasertex": lasertex.LasertexSettings,
    "line": line.LineSettings,
    "nd": nd.NdSettings,
    "qudis": qudis.QudisSettings,
    "tqd": tqd.TqdSettings,
    "umd": umd.UmdSettings,
}
OWN_SETTINGS = {"elcomat": "angles", "wyler": "angles", "ptu300": "air", "air-line": "air"}
"""Where a format has no settings of its own name."""
TOLD = (
    "nominal_rate_hz",
    "gaps_visible",
    "latency_s",
    "greeting",
    "request",
    "poll_interval_s",
    "others",
)


def raw(said: Any) -> bytes:
    """Return the bytes that a reference file means."""
    return (
        bytes.fromhex(said["hex"]) * said.get("times", 1)
        if isinstance(said, dict)
        else said.encode("latin-1")
    )


def settings_of(kind: str, said: dict[str, Any]) -> Any:
    """Return the settings, lists as tuples."""
    return SETTINGS[kind](
        **{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in said.items()
        }
    )


def decoder(told: dict[str, Any]) -> Any:
    """Play chunks into a decoder: what it says of itself before and after, and the batch of every
    chunk that gives one."""
    name = told["format"]
    made = make_decoder(
        name.removeprefix("air-"), settings_of(OWN_SETTINGS.get(name, name), told["settings"])
    )
    begins, batches, respond = _says(made), [], None
    for at, (act, *rest) in enumerate(told["steps"]):
        if act == "resync":
            made.resync()
        elif act == "steady":
            found = made.feed_steady([(raw(data), time_ns) for data, time_ns in rest[0]])
            batches.append([at, None if found is None else _batch(found)])
        elif act == "respond":
            respond = respond or made.responder()
            batches.append([at, plain(respond(raw(rest[0])))])
        else:
            found = made.feed(raw(rest[0]), 1000 * at)
            batches += [[at, _batch(found)]] if len(found) or found.notices else []
    return {"begins": begins, "batches": batches, "ends": _says(made)}


def _says(made: Any) -> dict[str, Any]:
    return {name: plain(getattr(made, name)) for name in TOLD if hasattr(made, name)}


def _batch(found: Samples) -> dict[str, Any]:
    columns = [found.counter, found.position_mm, found.beam, found.flags, found.arrival_ns]
    notices = [
        [each.code, each.index, each.name or plain(each.why), plain(each.value)]
        for each in found.notices
    ]
    return {
        "rows": [
            [None if value == "nan" else value for value in plain(row)]
            for row in zip(*columns, strict=True)
        ],
        "channels": None if found.channels is None else plain(found.channels),
        "notices": notices,
    }


def settings(told: list[Any]) -> Any:
    """Play settings: accepted, or the words of the refusal."""
    return [_accepted(kind, said) for kind, said in told]


def _accepted(kind: str, said: dict[str, Any]) -> str:
    try:
        settings_of(kind, said)
    except StepdiagError as refusal:
        return f"{type(refusal).__name__}: {plain(refusal.message)}"
    return "accepted"


def counter(told: dict[str, Any]) -> Any:
    """Play counts: what each run becomes, and whether it went on by ones."""
    track, found = CounterTrack([Wrap(*wrap) for wrap in told["wraps"]]), []
    for step in told["steps"]:
        if step == "forget":
            track.forget()
            continue
        counts = np.array(step["counts"], dtype=np.int64)
        goes_on = track.goes_on(counts)
        followed = track.follow(counts, restarted=step.get("restarted", False))
        found.append({"goes_on": goes_on, **plain(followed)})
    return found


def checksums(told: list[str]) -> Any:
    """Return every checksum of some bytes, of the catalogue and of parameters that it does not
    name."""
    others = [
        Crc(width=width, polynomial=polynomial, start=start, reflected=reflected)
        for width, polynomial in ((8, 0x9B), (8, 0x07), (16, 0x8BB7), (16, 0xC867))
        for start in (0, 0xFF if width == 8 else 0xB2AA)
        for reflected in (False, True)
    ]
    made = dict(CHECKSUMS) | {str(plain(crc)): checksum(crc) for crc in others}
    return {
        name: [each.size, *(each.of(raw(text)) for text in told)]
        for name, each in made.items()
    }


def frames(told: dict[str, Any]) -> Any:
    """Play chunks into a buffer of frames whose last byte is the sum of those before."""
    buffer = FrameBuffer(
        raw(told["sync"]), told["size"], lambda frame: frame[-1] == sum(frame[:-1]) % 256
    )
    found = []
    for chunk in told["chunks"]:
        if chunk == "clear":
            buffer.clear()
            continue
        parts = list(buffer.feed(raw(chunk)))
        found.append(
            [
                plain(part.why)
                if isinstance(part, Junk)
                else [row.tobytes().hex() for row in part]
                for part in parts
            ]
        )
    return found


def lines(told: dict[str, Any]) -> Any:
    """Play chunks into a buffer of lines, each looked at before it is taken."""
    buffer, found = LineBuffer(told["cap"], raw(told.get("terminator", "\n"))), []
    for chunk in told["chunks"]:
        if chunk == {"skip": True}:
            buffer.skip_line()
            continue
        seen = buffer.preview(raw(chunk)).decode("latin-1")
        taken = buffer.feed(raw(chunk))
        found.append([seen, taken.decode("latin-1"), quote(taken)])
    return found


def layout(told: dict[str, Any]) -> Any:
    """Read layouts, and the columns of a frame in both orders."""
    found = []
    for texts, start in told["layouts"]:
        try:
            places, end = read_layout(tuple(texts), start)
        except ValueError as error:
            found.append(type(error).__name__)
            continue
        data = np.frombuffer(raw(told["frame"]), dtype=np.uint8).reshape(2, -1)
        orders: tuple[Any, ...] = ("little", "big")
        columns = {
            name: [plain(place.column(data, order)) for order in orders]
            for name, place in places.items()
            if end <= data.shape[1]
        }
        found.append({"places": plain(places), "end": end, "columns": columns})
    return found


def units(told: list[list[Any]]) -> Any:
    """Return the millimetres of units."""
    return [
        plain(mm_per_unit(unit, wavelength_nm, optics))
        for unit, wavelength_nm, optics in told
    ]


def umd_lines(told: list[Any]) -> Any:
    """Return what blocks of lines hold, and whether they were taken as a whole."""
    found = []
    for said in told:
        block = raw(said)
        parts = [
            [part.code, plain(part.why)] if isinstance(part, OddLine) else part.tolist()
            for part in parse_lines(block)
        ]
        rows = uniform_rows(block) if block.endswith(b"\n") else None
        found.append({"parts": parts, "uniform": rows is not None})
    return found


def umd_board(told: dict[str, Any]) -> Any:
    """Play codes into a board: what each gives rise to and how lines are read from then on."""
    board, found = Board(told["phase_bits"]), []
    for code, data in told["codes"]:
        knew = board.knows(code, data)
        said = board.hear(code, data)
        found.append(
            [
                knew,
                plain(said),
                plain(board.reading),
                board.rate_hz,
                board.counts_every_sample,
                board.knows(code, data),
            ]
        )
    return found


def umd_reading(told: dict[str, Any]) -> Any:
    """Interpret columns."""
    columns = [np.array(column, dtype=np.int64) for column in zip(*told["rows"], strict=True)]
    return [plain(part) for part in Reading(**told["reading"]).interpret(*columns)]


def recognised(told: list[Any]) -> Any:
    """Return which instrument some bytes are of, and what is said where nothing makes sense."""
    return [
        plain(
            [
                recognise(raw(said)),
                senseless("nd", raw(said), len(raw(said)), ""),
                senseless("umd", raw(said), 7, "odd"),
                refused("nd", ""),
            ]
        )
        for said in told
    ]


def expressions(told: list[dict[str, Any]]) -> Any:
    """Parse expressions, and work them out for one poll after the other."""
    found = []
    for each in told:
        kinds = each.get("kinds", {"a": "bit", "b": "bit", "v": "word", "w": "word"})
        try:
            parsed = parse_expression(each["text"], kinds, "survey: plc.expressions.stopped")
        except StepdiagError as refusal:
            found.append(f"{type(refusal).__name__}: {plain(refusal.message)}")
            continue
        memory = Memory()
        values = [plain(parsed.value(inputs, memory)) for inputs in each["inputs"]]
        found.append({"kind": parsed.kind, "names": sorted(parsed.names), "values": values})
    return found


def signals(told: dict[str, Any]) -> Any:
    """Decode blocks of registers with a map, and say of the map what is asked for."""
    whole = told["signals"] == "contract"
    specs = (
        dict(CONTRACT_SIGNALS)
        if whole
        else {name: SignalSpec(**said) for name, said in told["signals"].items()}
    )
    kinds: dict[str, Any] = {
        name: "bit" if spec.type == "bit" or spec.in_bit_table else "word"
        for name, spec in specs.items()
    }
    made = {
        name: parse_expression(text, kinds, name)
        for name, text in told.get("expressions", {}).items()
    }
    reader, found = SignalDecoder(specs, made), []
    standing = told.get("standing", ["stopped"])
    for block in told["blocks"]:
        ranges = (
            tuple(ReadRange(*asked) for asked in block["ranges"])
            if "ranges" in block
            else plan_reads(specs, standing)
        )
        try:
            said = reader.decode(ModbusBlock(0, 1, ranges, tuple(map(raw, block["data"]))))
            told_of = {
                name: value for name, value in plain(said).items() if value is not None
            }
            found.append(
                {
                    "signals": told_of,
                    "unanswered": reader.unanswered(
                        ModbusBlock(0, 1, ranges, tuple(map(raw, block["data"])))
                    ),
                }
            )
        except StepdiagError as refusal:
            found.append(f"{type(refusal).__name__}: {plain(refusal.message)}")
    return {
        "reads": plain(plan_reads(specs, standing)),
        "places": {name: describe(spec) for name, spec in specs.items()},
        "widths": {
            name: [spec.width, spec.in_bit_table, spec.in_byte_table]
            for name, spec in specs.items()
        },
        "registers": plain(registers(specs.values())),
        "resolutions": {
            name: [plain(resolution(spec, value)) for value in (0.5, 1234.5)]
            for name, spec in specs.items()
        },
        "said": plain(found),
    }


def plan(told: dict[str, Any]) -> Any:
    """Return the requests that read runs of signals: ``[how many, between two addresses, the first
    one]``."""
    runs = enumerate(
        [*told["runs"], [1, 0, told["stopped"]]] if "stopped" in told else told["runs"]
    )
    specs = {
        "stopped"
        if "stopped" in told and at == len(told["runs"])
        else f"w{at}-{k}": SignalSpec(**first | {"address": first["address"] + k * stride})
        for at, (count, stride, first) in runs
        for k in range(count)
    }
    return plain(plan_reads(specs))


CALLS: dict[str, Callable[[Any], Any]] = {
    "decoder": decoder,
    "settings": settings,
    "counter": counter,
    "checksums": checksums,
    "frames": frames,
    "lines": lines,
    "layout": layout,
    "units": units,
    "umd-lines": umd_lines,
    "umd-board": umd_board,
    "umd-reading": umd_reading,
    "recognised": recognised,
    "expressions": expressions,
    "signals": signals,
    "plan": plan,
}
