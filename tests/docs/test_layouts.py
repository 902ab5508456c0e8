"""The layouts for the viewers: every curve in them is a field of a channel of our logs."""

import json
import re
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree as ET

import msgspec
import pytest
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from stepdiag.daq.log.topics import CHANNELS, DECODED_CHANNELS
from stepdiag.daq.records.status import LinkStatus
from stepdiag.daq.service.metrics import Figures, Tally
from stepdiag.daq.timing.samples import Flag
from stepdiag.page.metrics import _Daemon

DOCS = Path(__file__).parents[2] / "docs"
FIELDS = {
    (channel.topic, name)
    for channel in (*CHANNELS, *DECODED_CHANNELS.values())
    for name in channel.properties
}


def foxglove() -> list[tuple[str, str]]:
    panels = json.loads((DOCS / "layouts/foxglove.json").read_text(encoding="utf-8"))[
        "configById"
    ]
    curves = [curve["value"] for panel in panels.values() for curve in panel.get("paths", ())]
    return [(topic, field) for topic, _, field in (curve.partition(".") for curve in curves)]


def plotjuggler() -> list[tuple[str, str]]:
    layout = ET.parse(DOCS / "layouts/plotjuggler.xml")
    curves = [curve.get("name", "") for curve in layout.iter("curve")]
    return [(topic, field) for topic, _, field in (curve.rpartition("/") for curve in curves)]


@pytest.mark.parametrize(
    "curves", [foxglove(), plotjuggler()], ids=["foxglove", "plotjuggler"]
)
def test_every_curve_is_in_a_log(curves: list[tuple[str, str]]) -> None:
    assert curves
    assert set(curves) <= FIELDS


def test_every_panel_stands_in_the_layout_and_shows_a_topic_that_is_there() -> None:
    layout = json.loads((DOCS / "layouts/foxglove.json").read_text(encoding="utf-8"))
    placed = set(re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout["layout"])))
    assert placed == set(layout["configById"])
    topics = {channel.topic for channel in CHANNELS}
    shown = {
        *layout["configById"]["3D!volume"]["topics"],
        layout["configById"]["RosOut!log"]["topicToRender"],
    }
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


class Grid(msgspec.Struct, forbid_unknown_fields=True):
    """Where a panel stands: Grafana's grid has 24 columns."""

    x: int
    y: int
    w: int
    h: int


class Source(msgspec.Struct, forbid_unknown_fields=True):
    type: Literal["prometheus"]
    uid: Literal["${datasource}"]


class Target(msgspec.Struct, forbid_unknown_fields=True):
    refId: str  # Grafana's names
    datasource: Source
    expr: str
    legendFormat: str


class Panel(msgspec.Struct):
    id: int
    type: Literal["stat", "timeseries", "state-timeline"]
    title: str
    datasource: Source
    gridPos: Grid
    targets: list[Target]
    fieldConfig: dict[Literal["defaults", "overrides"], Any]


class Dashboard(msgspec.Struct):
    title: str
    uid: str
    schemaVersion: int
    panels: list[Panel]
    templating: dict[Literal["list"], list[dict[str, Any]]]


FUNCTIONS = {"rate", "increase", "sum", "max", "by", "label_values"}


def served() -> dict[str, set[str]]:
    """Return the labels of every figure that the daemon can have for Prometheus, as Prometheus gets
    them."""
    tally = Tally(stops=3, findings={"beam-lost": 2}, surveys={0: 1}, solve_s=2.5)
    links = {
        name: LinkStatus(state="connected", address="", age_s=0.1)
        for name in ("laser", "machine")
    }
    now = Figures(
        samples=10,
        lost_events=0,
        recording=True,
        recorder_blocked=False,
        backlog_bytes=0,
        disk_free_bytes=1,
        watchdog_age_s=0.1,
        links=links,
        tally=tally,
    )
    registry = CollectorRegistry()
    registry.register(_Daemon(now))
    told = generate_latest(registry).decode()
    return {
        sample.name: set(sample.labels)
        for family in text_string_to_metric_families(told)
        for sample in family.samples
    }


def test_the_grafana_dashboard_is_whole_and_asks_for_nothing_but_figures_of_the_daemon() -> (
    None
):
    text = (DOCS / "layouts/grafana.json").read_text(encoding="utf-8")
    dashboard = msgspec.json.decode(text, type=Dashboard)
    assert len({panel.id for panel in dashboard.panels}) == len(dashboard.panels)
    known, asked = served(), set()
    variables = {each["name"] for each in dashboard.templating["list"]} | {"__rate_interval"}
    for target in (target for panel in dashboard.panels for target in panel.targets):
        names = set(re.findall(r"stepdiag_\w+", target.expr))
        labels = {each for name in names for each in known.get(name, set())} | {"instance"}
        asked |= names
        assert names <= known.keys(), target.expr
        assert set(re.findall(r"{{(\w+)}}", target.legendFormat)) <= labels, (
            target.legendFormat
        )
        assert set(re.findall(r"\$(\w+)", target.expr)) <= variables, target.expr
        words = set(re.findall(r"[a-z_]+(?=\s*\()", target.expr))
        assert words <= FUNCTIONS, target.expr
    assert asked == known.keys(), "every figure is shown"


def test_no_panel_of_the_dashboard_lies_on_another() -> None:
    dashboard = msgspec.json.decode(
        (DOCS / "layouts/grafana.json").read_bytes(), type=Dashboard
    )
    cells = [
        (x, y)
        for p in (panel.gridPos for panel in dashboard.panels)
        for x in range(p.x, p.x + p.w)
        for y in range(p.y, p.y + p.h)
    ]
    assert len(set(cells)) == len(cells)
    assert all(0 <= x < 24 for x, _ in cells)
