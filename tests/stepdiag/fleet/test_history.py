"""Which surveys of a machine are held against one another: what stands apart, what is brought
together, what is left out."""

import json
from dataclasses import asdict, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stepdiag.comparing.alike import Standing
from stepdiag.fleet.history import History, history_in, history_of
from stepdiag.fleet.rows import RMS, About, Row
from stepdiag.fleet.store import Store
from stepdiag.fleet.tables import index_of, table_of
from stepdiag.fleet.trend import trends_of
from testkit.cli import stepdiag
from testkit.fleets import FIRST, NOW, series_of, write_history

USUAL = Standing(
    chain="FXYZ",
    machine_serial="7",
    lengths="at_20_c",
    volume_mm=(0, 0, 0, 500, 400, 300),
    increments=10,
)
QUARTER = timedelta(days=91)


def history(
    *standings: Standing,
    nodes: tuple[tuple[float, ...], ...] = (),
    times: tuple[datetime, ...] = (),
    factor: tuple[float, ...] = (),
) -> History:
    """Return the history of a machine: a survey each, with a bow of 10 µm as EYX and a volumetric
    error of 5 um."""
    tables = []
    for number, standing in enumerate(standings):
        about = About(
            machine="M",
            survey=f"{number:016x}",
            time=times[number] if times else FIRST + number * QUARTER,
            event="",
            method="estimate",
            software="1",
            conditions=json.dumps({"active": [], **asdict(standing)}),
        )
        at = np.array(nodes[number] if nodes else (0.0, 125.0, 250.0, 375.0, 500.0))
        bow = (factor[number] if factor else 1.0) * 10 * np.sin(np.pi * at / 500)
        rows = [
            Row(
                quantity=RMS,
                axis="",
                position_mm=None,
                value=5.0,
                u=0.2,
                unit="um",
                low=4.8,
                high=5.6,
            )
        ]
        rows += [
            Row(quantity="EYX", axis="X", position_mm=x, value=y, u=0.2, unit="um")
            for x, y in zip(at.tolist(), bow.tolist(), strict=True)
        ]
        tables.append((table_of(about, rows), f"place{number}"))
    return history_of(index_of(tables), NOW)


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ({"machine_serial": "8"}, "another machine: serial number 7 instead of 8"),
        ({"chain": "XFYZ"}, "another chain: FXYZ instead of XFYZ"),
        (
            {"lengths": "as_measured"},
            "other lengths: lengths at 20 C instead of lengths as measured",
        ),
    ],
)
def test_what_is_not_alike_stands_apart_with_its_reason(other, why):
    found = history(USUAL, USUAL, replace(USUAL, **other)).series
    assert [
        (each.quantity, len(each.surveys), "" if each.other is None else str(each.other))
        for each in found
    ] == [
        ("EYX", 1, ""),
        ("EYX", 2, why),
        (RMS, 1, ""),
        (RMS, 2, why),
    ]


def test_a_result_that_states_nothing_is_held_against_all():
    assert [len(each.surveys) for each in history(Standing(), USUAL, Standing()).series] == [
        3,
        3,
    ]


def test_another_volume_parts_the_figures_of_the_volume_and_brings_functions_to_the_common_part():
    half = replace(USUAL, volume_mm=(0, 0, 0, 250, 400, 300))
    found = history(
        USUAL, USUAL, half, half, nodes=((0, 125, 250, 375, 500),) * 2 + ((0, 125, 250),) * 2
    )
    function, *volumetric = found.series
    assert function.nodes_mm.tolist() == [0, 125, 250]
    assert np.ptp(function.values, axis=0) == pytest.approx(0, abs=1e-6)
    assert [
        (len(each.surveys), "" if each.other is None else str(each.other))
        for each in volumetric
    ] == [(2, ""), (2, "another volume")]
    assert {each.verdict for each in trends_of(found.series, lambda *_: None)} == {
        "unchanged"
    }


def test_other_increments_are_no_change():
    found = history(
        USUAL,
        USUAL,
        USUAL,
        USUAL,
        nodes=((0, 250, 500),) * 2 + ((0, 125, 250, 375, 500),) * 2,
    )
    assert found.series[0].nodes_mm.tolist() == [0, 250, 500]
    assert {each.verdict for each in trends_of(found.series, lambda *_: None)} == {
        "unchanged"
    }


def test_a_sign_that_turned_is_found():
    """The range of the function stays."""
    function, _ = trends_of(
        history(USUAL, USUAL, USUAL, factor=(1, 1, -1)).series, lambda *_: None
    )
    assert function.verdict == "changed"
    assert np.ptp(function.series.shown[:, 0]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("year", [1970, 1980, 2099])
def test_a_date_that_cannot_be_is_left_out_and_hides_nothing(year):
    found = history(
        USUAL,
        USUAL,
        USUAL,
        times=(FIRST, datetime(year, 1, 1, tzinfo=FIRST.tzinfo), FIRST + QUARTER),
    )
    assert [len(each.surveys) for each in found.series] == [2, 2]
    assert [str(each.why) for each in found.left_out] == [
        f"the date is impossible: {year}-01-01"
    ]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"errors": ("noise-far",)}, "the result has errors: noise-far"),
        ({"undated": True}, "the date is impossible: 2020-04-15"),
    ],
)
def test_results_with_errors_and_clocks_that_were_never_set_are_left_out(wrong, why):
    found = history(USUAL, replace(USUAL, **wrong), USUAL)
    assert (
        [len(each.surveys) for each in found.series],
        [str(each.why) for each in found.left_out],
    ) == ([2, 2], [why])


@pytest.mark.parametrize(
    "conditions",
    [
        "",
        "[]",
        "7",
        '{"chain": 3, "volume_mm": "x", "errors": [null], "active": 1}',
        "{" * 5000,
    ],
)
def test_whatever_stands_in_the_conditions_is_no_traceback(conditions):
    about = About(
        machine="M",
        survey="1",
        time=FIRST,
        event="",
        method="estimate",
        software="1",
        conditions=conditions,
    )
    row = Row(quantity=RMS, axis="", position_mm=None, value=5.0, u=0.2, unit="um")
    (series,) = history_of(index_of([(table_of(about, [row]), "p")]), NOW).series
    assert series.surveys[0].standing == Standing()


def test_a_damaged_table_hides_no_other_machine(tmp_path: Path):
    store = Store(str(tmp_path / "store"), create=True)
    write_history(store, "whole", [5.0, 5.1])
    write_history(store, "harmed", [5.0, 5.1])
    table = next(place.table for place in store.tables() if place.machine == "harmed")
    Path(store.path(table)).write_bytes(b"PAR1")
    found = history_in(store, NOW)
    assert [(each.machine, len(each.surveys)) for each in found.series] == [
        ("harmed", 1),
        ("whole", 2),
    ]
    assert [(each.name, each.damaged) for each in found.left_out] == [(table, True)]
    shown = stepdiag("trend", store.root)
    assert shown.code == 3
    assert "whole" in shown.out
    assert (
        json.loads(stepdiag("trend", store.root, "--json").out)["left_out"][0]["survey"]
        == table
    )
    sheet = tmp_path / "sheet.html"
    stepdiag("trend", store.root, "--report", sheet, "--language", "de")
    assert table in sheet.read_text(encoding="utf-8")


def test_the_interval_of_a_skewed_figure_is_shown_as_it_is(tmp_path: Path):
    (_, volumetric) = history(USUAL, USUAL).series
    assert volumetric.points[0][1:] == (5.0, 0.2, 4.8, 5.6)
    assert volumetric.values[:, 0].tolist() == pytest.approx([5.2, 5.2])


def test_tables_of_before_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Version 1 has no common part and no skewed interval."""
    from stepdiag.fleet import tables

    store = Store(str(tmp_path / "store"), create=True)
    with monkeypatch.context() as before:
        before.setattr(tables, "VERSION", "1")
        before.setattr(
            "testkit.fleets.to_parquet",
            lambda table: tables.to_parquet(table.drop_columns(["u_common", "low", "high"])),
        )
        write_history(store, "M", [5.0, 5.1])
    (series,) = series_of(store)
    assert series.common.tolist() == [0.0, 0.0]
    assert [point.value for point in series.points] == [5.0, 5.1]


@pytest.mark.parametrize(
    "volume", [[1, 2], [0] * 7, ["a"] * 6, [0, 0, 0, 500, 400, "x"], "500"]
)
def test_a_volume_that_no_result_has_is_none(volume):
    """A table that somebody altered hides no other survey."""
    assert [
        len(each.surveys)
        for each in history(USUAL, replace(USUAL, volume_mm=volume), USUAL).series
    ] == [3, 3]


def test_a_number_in_place_of_a_function_is_not_decided():
    shared = {
        "machine": "M",
        "event": "",
        "method": "estimate",
        "software": "1",
        "conditions": "{}",
    }
    rows = [
        [Row(quantity="EYX", axis="X", position_mm=None, value=1.0, u=0.2, unit="um")],
        [
            Row(quantity="EYX", axis="X", position_mm=at, value=1.0, u=0.2, unit="um")
            for at in (0.0, 100.0)
        ],
    ]
    tables = [
        (
            table_of(
                About(survey=f"{number}", time=FIRST + number * QUARTER, **shared), each
            ),
            f"place{number}",
        )
        for number, each in enumerate(rows)
    ]
    (found,) = trends_of(history_of(index_of(tables), NOW).series, lambda *_: None)
    assert (len(found.series.surveys), found.verdict) == (2, "undecided")
