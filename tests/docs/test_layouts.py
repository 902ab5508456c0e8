"""The layouts for the viewers: every curve in them is a field of a channel of our logs."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from stepdiag.daq.log.topics import CHANNELS, DECODED_CHANNELS
from stepdiag.daq.timing.samples import Flag

DOCS = Path(__file__).parents[2] / "docs"
FIELDS = {(channel.topic, name) for channel in (*CHANNELS, *DECODED_CHANNELS.values()) for name in channel.properties}


def foxglove() -> list[tuple[str, str]]:
    panels = json.loads((DOCS / "layouts/foxglove.json").read_text(encoding="utf-8"))["configById"]
    curves = [curve["value"] for panel in panels.values() for curve in panel.get("paths", ())]
    return [(topic, field) for topic, _, field in (curve.partition(".") for curve in curves)]


def plotjuggler() -> list[tuple[str, str]]:
    layout = ET.parse(DOCS / "layouts/plotjuggler.xml")
    curves = [curve.get("name", "") for curve in layout.iter("curve")]
    return [(topic, field) for topic, _, field in (curve.rpartition("/") for curve in curves)]


@pytest.mark.parametrize("curves", [foxglove(), plotjuggler()], ids=["foxglove", "plotjuggler"])
def test_every_curve_is_in_a_log(curves: list[tuple[str, str]]) -> None:
    assert curves
    assert set(curves) <= FIELDS


def test_every_panel_stands_in_the_layout_and_shows_a_topic_that_is_there() -> None:
    layout = json.loads((DOCS / "layouts/foxglove.json").read_text(encoding="utf-8"))
    placed = set(re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout["layout"])))
    assert placed == set(layout["configById"])
    topics = {channel.topic for channel in CHANNELS}
    shown = {*layout["configById"]["3D!volume"]["topics"], layout["configById"]["RosOut!log"]["topicToRender"]}
    assert shown | {layout["configById"]["RawMessages!finding"]["topicPath"]} <= topics


def test_the_page_names_every_topic_and_flag() -> None:
    page = (DOCS / "viewers.md").read_text(encoding="utf-8")
    assert [
        topic
        for topic in (channel.topic for channel in CHANNELS)
        if topic not in page and not topic.startswith("/link/") and topic != "/recorder/loss"
    ] == []
    bits = re.search(r"\| bit \|(.+)\|\n", page)
    assert bits is not None
    assert [int(bit) for bit in bits[1].split("|")] == [flag.value for flag in Flag]
