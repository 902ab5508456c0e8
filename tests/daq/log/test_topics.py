"""Channels and notes: what Foxglove and PlotJuggler must be able to read."""

import json
from typing import Any

import msgspec
import numpy as np
import pytest

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.base.volume import Volume
from stepdiag.daq.capture.captured_stop import CapturedStop, Remark
from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.log.scene import MOST_DRAWN, scene_note
from stepdiag.daq.log.topics import (
    CHANNELS,
    LINK_STATES,
    Channel,
    Note,
    finding_note,
    log_note,
    sample_note,
    signals_note,
    stop_note,
)
from testkit.schema_dialect import dialect_faults

SCHEMAS: dict[str, dict[str, Any]] = {
    channel.topic: json.loads(channel.schema) for channel in CHANNELS
}
STOP = CapturedStop(
    setup="ppp",
    outward=True,
    stop=3,
    position_mm=(1.0, 2.0, 3.0),
    axis="z",
    stop_count=4,
    reading_mm=3.7,
    u_um=0.1,
    scatter_um=0.3,
    slope_um_s=0.0,
    samples=300,
    rejected=1,
    window_from_ns=5,
    window_to_ns=7,
    time_s=1.7e9,
    beam=0.9,
    channels=(1.0,),
    u_channels=(0.1,),
    material_temperature_c=20.1,
    air_temperature_c=20.2,
    air_pressure_hpa=1000.0,
    relative_humidity_percent=40.0,
)
VOLUME = Volume(origin_mm=(0.0, -10.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=4)
NOTES = [
    sample_note(1, 1.5, 0.9, 0),
    signals_note(
        2,
        Signals(
            stopped=True,
            running=True,
            alarm=False,
            heartbeat=1,
            stop_count=2,
            setup=1,
            x_mm=1.0,
            y_mm=2.0,
            z_mm=3.0,
        ),
    ),
    stop_note(STOP, 3.7, -1.25),
    scene_note(VOLUME, np.array([(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)]), [STOP]),
    finding_note(5, Finding(code="beam-lost", severity="error", text="words")),
    finding_note(
        5,
        finding(
            "warning",
            message("method-limited.runs", others=["ppp+1"]),
            Place(setup="ppp", stop=3),
        ),
    ),
    log_note(6, "info", "words", "daq"),
]
JSON_TYPES = {
    "number": int | float,
    "integer": int,
    "string": str,
    "boolean": bool,
    "array": list | tuple,
}


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.topic)
def test_every_channel_is_in_the_dialect_of_the_viewers(channel: Channel) -> None:
    assert dialect_faults(channel.topic, SCHEMAS[channel.topic]) == []
    assert channel.schema_name


@pytest.mark.parametrize(
    ("part", "fault"),
    [
        ({"type": ["number", "null"]}, "not one plain type"),
        ({"anyOf": [{"type": "number"}]}, "anyOf"),
        ({"$ref": "#/x"}, "$ref"),
        ({"enum": ["a"]}, "not one plain type"),
        (
            {"type": "array", "items": {"type": "array", "items": {"type": "number"}}},
            "array of arrays",
        ),
        ({"type": "array"}, "not one plain type"),
        ({"type": "object"}, "object without properties"),
        (
            {"type": "object", "properties": {"a": {"type": "object"}}},
            "part.a: object without properties",
        ),
    ],
)
def test_the_checker_finds_what_viewers_refuse(part: dict[str, Any], fault: str) -> None:
    """acquisition.md B2, rule 4: the forms that were found to be rejected."""
    (found,) = dialect_faults("/a/b", {"type": "object", "properties": {"part": part}})
    assert fault in found


def test_the_checker_wants_a_root_and_a_topic() -> None:
    assert len(dialect_faults("Laser Raw", {"type": "array"})) == 2


@pytest.mark.parametrize("note", NOTES, ids=lambda note: note.topic)
def test_every_note_fits_the_schema_of_its_channel(note: Note) -> None:
    """Every field is in the schema with its type; what is None is unknown and will be left out."""
    properties = SCHEMAS[note.topic]["properties"]
    for name, value in note.fields.items():
        assert name in properties
        assert value is None or isinstance(value, JSON_TYPES[properties[name]["type"]])


def test_a_captured_stop_goes_into_the_log_whole() -> None:
    names = {field.encode_name for field in msgspec.structs.fields(CapturedStop)} - {
        "doubts"
    } | {
        "doubtful",
        "doubt_codes",
        "messages",
    }
    logged = {name.replace("_mono_ns", "_ns") for name in stop_note(STOP).fields}
    assert logged == names
    assert stop_note(STOP).time_ns == 7


def test_the_number_of_a_link_state_is_its_place() -> None:
    """PlotJuggler drops texts and shows the number."""
    assert LINK_STATES == ("connecting", "connected", "silent", "lost")


def test_a_stop_says_where_it_should_read_and_by_how_much_it_is_off() -> None:
    fields = stop_note(STOP, 3.7, -1.25).fields
    assert (fields["nominal_mm"], fields["deviation_um"]) == (3.70125, -1.25)
    assert "deviation_um" not in stop_note(STOP).fields, (
        "a count that does not reach back says nothing of it"
    )


def test_the_scene_holds_box_route_and_stops_in_metres() -> None:
    """Twelve edges of the volume, the route, a sphere for each stop, doubtful ones in another
    colour; a long pass stays small."""
    doubted = msgspec.structs.replace(
        STOP,
        stop=4,
        position_mm=(500.0, 390.0, 300.0),
        doubts=(Remark("stop-doubtful", "unsteady"),),
    )
    (entity,) = scene_note(
        VOLUME, np.array([(0.0, -10.0, 0.0), (500.0, 390.0, 300.0)]), [STOP, doubted]
    ).fields["entities"]
    box, route = entity["lines"]
    assert (box["type"], len(box["points"]), route["type"], len(route["points"])) == (
        2,
        24,
        0,
        2,
    )
    assert [max(point[axis] for point in box["points"]) for axis in "xyz"] == [0.5, 0.39, 0.3]
    assert [one["pose"]["position"] for one in entity["spheres"]] == [
        {"x": 0.001, "y": 0.002, "z": 0.003},
        {"x": 0.5, "y": 0.39, "z": 0.3},
    ]
    assert entity["spheres"][0]["color"] != entity["spheres"][1]["color"]
    long = scene_note(VOLUME, np.arange(6000.0).reshape(-1, 3), [STOP] * 2000).fields[
        "entities"
    ][0]
    assert (len(long["lines"][1]["points"]), len(long["spheres"])) == (2, MOST_DRAWN)
