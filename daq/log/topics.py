"""The channels of a log: topic, schema, and notes for a viewer.

Foxglove and PlotJuggler read JSON messages with schemas of a narrow dialect: the root is an object
with properties, each property has one plain type, and there are no unions, references or arrays of
arrays (acquisition.md B2, rule 4). The names of properties contain the units. A state is logged as
number and as text, because PlotJuggler discards texts (acquisition.md B2, rule 6). An unknown value
is left out of a message.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import msgspec

from stepdiag.base.findings import Finding
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.formats.signals import COUNTED, SIGNAL_NAMES, SWITCHED, Signals
from stepdiag.daq.records.events import Link, Stream
from stepdiag.daq.records.status import LinkState

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
NUMBERS: Schema = {"type": "array", "items": NUMBER}
INTEGERS: Schema = {"type": "array", "items": INTEGER}
TEXTS: Schema = {"type": "array", "items": TEXT}
TIME: Schema = {
    "type": "object",
    "title": "time",
    "properties": {"sec": INTEGER, "nsec": INTEGER},
}
"""Schema of a wall time in seconds and nanoseconds: a number of a viewer cannot represent
nanoseconds since 1970.
"""


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel: its topic, the name of its schema, and the properties of its messages."""

    topic: str
    schema_name: str
    properties: Mapping[str, Schema]

    @property
    def schema(self) -> bytes:
        return json.dumps(
            {"title": self.schema_name, "type": "object", "properties": self.properties}
        ).encode()


@dataclass(frozen=True, slots=True)
class Note:
    """A message for a viewer, computed from the raw events and ignored by a replay. ``time_ns`` is
    the time of the host's clock.
    """

    topic: str
    time_ns: int
    fields: Mapping[str, Any]


LINK_STATES: tuple[str, ...] = get_args(LinkState)

_STAMP = {"time": TIME, "t_mono_ns": TEXT}
_ORDER = {"order": INTEGER, "skip": INTEGERS, "run": INTEGERS}
_BYTES = {**_STAMP, **_ORDER, "after_us": INTEGERS, "data": TEXTS}
_BLOCKS = {
    **_STAMP,
    **_ORDER,
    "recv_us": INTEGERS,
    "answer_us": INTEGERS,
    "ranges": TEXT,
    "data": TEXTS,
}
_LINK = {
    **_STAMP,
    "order": INTEGER,
    "state": INTEGER,
    "state_text": TEXT,
    "detail": TEXT,
    "message": TEXT,
}
_LOSS = {
    **_STAMP,
    "order": INTEGER,
    "events": INTEGER,
    "bytes": INTEGER,
    "reason": TEXT,
    "message": TEXT,
}
_STOP = {
    "setup": TEXT,
    "outward": FLAG,
    "stop": INTEGER,
    "position_mm": NUMBERS,
    "axis": TEXT,
    "stop_count": INTEGER,
    "reading_mm": NUMBER,
    "u_um": NUMBER,
    "scatter_um": NUMBER,
    "slope_um_s": NUMBER,
    "samples": INTEGER,
    "rejected": INTEGER,
    "window_from_mono_ns": TEXT,
    "window_to_mono_ns": TEXT,
    "time_s": NUMBER,
    "nominal_mm": NUMBER,
    "deviation_um": NUMBER,
    "beam": NUMBER,
    "count": INTEGER,
    "broken": TEXT,
    "unwatched": TEXT,
    "doubtful": TEXT,
    "doubt_codes": TEXTS,
    "messages": TEXT,
    "held": TEXTS,
    "refused": TEXT,
    "recovered": FLAG,
    "turned": FLAG,
    "order": TEXT,
    "channels": NUMBERS,
    "u_channels": NUMBERS,
    "material_temperature_c": NUMBER,
    "air_temperature_c": NUMBER,
    "air_pressure_hpa": NUMBER,
    "relative_humidity_percent": NUMBER,
}
_SIGNALS = {
    **dict.fromkeys(SIGNAL_NAMES, NUMBER),
    **dict.fromkeys((name for name in SIGNAL_NAMES if name in COUNTED), INTEGER),
    **dict.fromkeys((name for name in SIGNAL_NAMES if name in SWITCHED), FLAG),
}
_PLACE = {
    "setup": TEXT,
    "pass": INTEGER,
    "way": TEXT,
    "stop": INTEGER,
    "last": INTEGER,
    "size_um": NUMBER,
}
_FINDING = {
    **dict.fromkeys(("severity_text", "code", "key", "action", "arguments", "text"), TEXT),
    **_PLACE,
}
_POINT: Schema = {"type": "object", "properties": dict.fromkeys("xyz", NUMBER)}
_COLOR: Schema = {"type": "object", "properties": dict.fromkeys("rgba", NUMBER)}
_POSE: Schema = {
    "type": "object",
    "properties": {
        "position": _POINT,
        "orientation": {"type": "object", "properties": dict.fromkeys("xyzw", NUMBER)},
    },
}
_LINES: Schema = {
    "type": "object",
    "properties": {
        "type": INTEGER,
        "pose": _POSE,
        "thickness": NUMBER,
        "scale_invariant": FLAG,
        "points": {"type": "array", "items": _POINT},
        "color": _COLOR,
        "indices": INTEGERS,
    },
}
_SPHERE: Schema = {
    "type": "object",
    "properties": {"pose": _POSE, "size": _POINT, "color": _COLOR},
}
_ENTITY: Schema = {
    "type": "object",
    "properties": {
        "timestamp": TIME,
        "frame_id": TEXT,
        "id": TEXT,
        "frame_locked": FLAG,
        "lines": {"type": "array", "items": _LINES},
        "spheres": {"type": "array", "items": _SPHERE},
    },
}
_DELETION: Schema = {
    "type": "object",
    "properties": {"timestamp": TIME, "type": INTEGER, "id": TEXT},
}
_SCENE = {
    "deletions": {"type": "array", "items": _DELETION},
    "entities": {"type": "array", "items": _ENTITY},
}
"""The used part of foxglove.SceneUpdate (docs.foxglove.dev, message schemas)."""
_FOXGLOVE_LOG = {
    "timestamp": TIME,
    "level": INTEGER,
    "message": TEXT,
    "name": TEXT,
    "file": TEXT,
    "line": INTEGER,
}

RAW_TOPICS: dict[Stream, str] = {
    "laser": "/laser/raw",
    "head": "/head/raw",
    "air": "/air/raw",
}
BLOCK_TOPIC = "/machine/raw"
LINK_TOPICS: dict[Link, str] = {
    "laser": "/link/laser",
    "head": "/link/head",
    "air": "/link/air",
    "machine": "/link/machine",
}
LOSS_TOPIC = "/recorder/loss"
SAMPLE_TOPIC = "/laser/sample"
SIGNALS_TOPIC = "/machine/state"
STOP_TOPIC = "/machine/stop"
FINDING_TOPIC = "/sync/finding"
LOG_TOPIC = "/log"
VOLUME_TOPIC = "/volume"
DECODED_TOPICS: dict[Stream, str] = {
    "laser": "/laser/decoded",
    "head": "/head/decoded",
    "air": "/air/decoded",
}
"""Topics of the samples in the files of ``stepdiag decode``; a log contains bytes, not samples."""

CHANNELS: tuple[Channel, ...] = (
    *(Channel(topic, "stepdiag.Bytes", _BYTES) for topic in RAW_TOPICS.values()),
    Channel(BLOCK_TOPIC, "stepdiag.ModbusBlocks", _BLOCKS),
    *(Channel(topic, "stepdiag.Link", _LINK) for topic in LINK_TOPICS.values()),
    Channel(LOSS_TOPIC, "stepdiag.Loss", _LOSS),
    Channel(
        SAMPLE_TOPIC,
        "stepdiag.Sample",
        {**_STAMP, "position_mm": NUMBER, "beam": NUMBER, "flags": INTEGER},
    ),
    Channel(SIGNALS_TOPIC, "stepdiag.Signals", {**_STAMP, **_SIGNALS}),
    Channel(STOP_TOPIC, "stepdiag.Stop", {**_STAMP, **_STOP}),
    Channel(FINDING_TOPIC, "stepdiag.Finding", {**_STAMP, "severity": INTEGER, **_FINDING}),
    Channel(LOG_TOPIC, "foxglove.Log", _FOXGLOVE_LOG),
    Channel(VOLUME_TOPIC, "foxglove.SceneUpdate", _SCENE),
)
"""The channels of a log, in the order of the channel ids from 1."""

DECODED_CHANNELS: dict[Stream, Channel] = {
    stream: Channel(
        topic,
        "stepdiag.Decoded",
        {
            **_STAMP,
            "counter": INTEGER,
            "position_mm": NUMBER,
            "beam": NUMBER,
            "flags": INTEGER,
            "channels": NUMBERS,
        },
    )
    for stream, topic in DECODED_TOPICS.items()
}

MESSAGES = ("broken", "unwatched", "doubts")
"""The fields of a stop's note whose text is JSON, because viewers require plain types; further
fields contain the English words.
"""
LOG_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "critical": 5}
"""Numbers of the levels of foxglove.Log."""


def sample_note(time_ns: int, position_mm: float, beam: float | None, flags: int) -> Note:
    return Note(
        SAMPLE_TOPIC, time_ns, {"position_mm": position_mm, "beam": beam, "flags": flags}
    )


def signals_note(time_ns: int, signals: Signals) -> Note:
    return Note(
        SIGNALS_TOPIC, time_ns, {name: getattr(signals, name) for name in SIGNAL_NAMES}
    )


def stop_note(
    stop: CapturedStop, travel_mm: float | None = None, deviation_um: float | None = None
) -> Note:
    """Return the note of a captured stop; its time is the end of the stop's window.

    ``travel_mm`` is the change of the reading since the first stop of the pass. ``deviation_um`` is
    the deviation of this change from the geometry. ``travel_mm`` and ``deviation_um`` are None if
    the count was lost since the first stop.
    """
    fields = msgspec.structs.asdict(stop)
    messages = {name: value for name in MESSAGES if (value := fields.pop(name))}
    fields |= {name: str(messages.get(name, "")) for name in ("broken", "unwatched")}
    fields |= {"doubtful": str(stop.why()), "doubt_codes": stop.doubt_codes}
    fields["messages"] = msgspec.json.encode(messages).decode() if messages else ""
    if travel_mm is not None and deviation_um is not None:
        fields |= {
            "nominal_mm": round(travel_mm - deviation_um * 1e-3, 6),
            "deviation_um": deviation_um,
        }
    for end in ("from", "to"):
        fields[f"window_{end}_mono_ns"] = str(fields.pop(f"window_{end}_ns"))
    return Note(STOP_TOPIC, stop.window_to_ns, fields)


def finding_note(time_ns: int, finding: Finding) -> Note:
    """Return the note of a finding. The number of its severity is a level of `/log`; its arguments
    are a JSON text, because viewers require plain types.
    """
    severity = {"severity": LOG_LEVELS[finding.severity], "severity_text": finding.severity}
    fields = finding.as_json()
    if "arguments" in fields:
        fields["arguments"] = json.dumps(fields["arguments"], ensure_ascii=False)
    place = {"way": finding.way or None, "last": finding.last}
    known = {name: value for name, value in place.items() if value is not None}
    return Note(FINDING_TOPIC, time_ns, {**fields, **known, **severity})


def log_note(time_ns: int, level: str, message: str, name: str) -> Note:
    """Return the note of a line of the program's log for Foxglove's Log panel; ``level`` is a key
    of `LOG_LEVELS`.
    """
    return Note(
        LOG_TOPIC,
        time_ns,
        {"level": LOG_LEVELS[level], "message": message, "name": name, "file": "", "line": 0},
    )
