"""The result and its JSON (contract 4)."""

import json
from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.errors import DataError
from stepdiag.base.messages import rendered
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import MEMBERS, parse_result
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import DIAGONALS, Bench, solved

RESULT = solve(Bench().survey(DIAGONALS))
TEXT = RESULT.to_json()


def test_the_json_is_what_the_contract_says():
    document = json.loads(TEXT)
    assert document["format"] == "stepdiag-result"
    assert document["version"] == 3
    assert document["volume"] == {
        "origin_mm": [0.0, 0.0, 0.0],
        "size_mm": [500.0, 400.0, 300.0],
        "increments": 10,
    }
    assert document["errors"]["EXX"].keys() >= {"position_mm", "value", "u", "unit"}
    assert document["squareness"]["C0Y"].keys() == {"value", "u", "u_readings", "unit"}
    assert document["scale"]["X"] == {
        "value": None,
        "u": None,
        "u_readings": None,
        "unit": "um/m",
        "identified": False,
    }
    assert document["errors"]["EXX"]["slope_identified"] is False
    assert all(
        finding.keys() - {"key"} == {"code", "severity", "action", "arguments", "text"}
        for finding in document["findings"]
    )
    assert TEXT.endswith("}\n")
    assert "\r" not in TEXT


def test_reading_back_gives_the_same_bytes_and_values():
    again = parse_result(TEXT)
    assert again.to_json() == TEXT
    assert np.allclose(again.errors["EYZ"].value, RESULT.errors["EYZ"].value, atol=1e-6)
    assert [replace(one, message=None) for one in again.findings] == [
        replace(one, message=None) for one in RESULT.findings
    ]
    assert [rendered(one.words, "en") for one in again.findings] == [
        one.text for one in RESULT.findings
    ], "figures as they are written"
    assert [getattr(again, name) is None for name in MEMBERS] == [
        getattr(RESULT, name) is None for name in MEMBERS
    ]


def test_u_is_the_combined_one_and_what_is_predicted_is_an_interval():
    """Contract 4, version 2: u_readings stands beside u; before and after, as it is and without
    rigid motion."""
    document = json.loads(TEXT)
    for number in document["squareness"].values():
        assert 0 < number["u_readings"] < number["u"]
    for part in ("without_rigid_motion", "as_it_is"):
        for when in ("before", "after"):
            for figure in document["predicted"][part][when].values():
                assert figure["low"] <= figure["value"] <= figure["high"]


def test_version_1_is_still_read():
    document = json.loads(TEXT) | {"version": 1}
    for name in ("expected", "posterior", "predicted", "volumetric_u_um"):
        del document[name]
    for part in ("errors", "squareness", "scale"):
        for entry in document[part].values():
            del entry["u_readings"]
    old = parse_result(json.dumps(document))
    assert old.posterior is None
    assert old.errors["EXX"].u_readings is None
    points = np.array([[0.0, 0.0, 0.0], [500.0, 400.0, 300.0]])
    told = predicted(old, points, np.zeros((2, 3))).as_it_is["after"].rms_um
    assert told.value_um > 0
    assert told.low_um is None
    assert told.high_um is None


def test_a_result_of_another_program_needs_only_what_the_contract_names():
    document = json.loads(TEXT) | {"version": 2}
    for name in ("software", "method", "reversal", "fit", "closure_um", "scale_sum_um"):
        del document[name]
    for function in document["errors"].values():
        del function["slope_identified"]
    assert parse_result(json.dumps(document)).method == ""


def changed(path, value):
    document = json.loads(TEXT)
    place = document
    for name in path[:-1]:
        place = place[name]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return json.dumps(document)


EMPTY = {"unit": "um", "slope_identified": True, "u_readings": None}


def test_a_function_may_have_two_positions_and_any_distance_between_them():
    read = parse_result(
        changed(
            ["errors", "EXY"],
            EMPTY
            | {
                "position_mm": [3.0, 3.25],
                "value": [1.0, -2.0],
                "u": [0.5, 0.5],
                "u_readings": None,
            },
        )
    )
    assert read.errors["EXY"].position_mm.tolist() == [3.0, 3.25]
    assert read.errors["EXY"].value.tolist() == [1.0, -2.0]


@pytest.mark.parametrize("increments", [1, 500])
def test_a_volume_may_have_as_few_and_as_many_increments_as_any_survey(increments):
    assert (
        parse_result(changed(["volume", "increments"], increments)).volume.increments
        == increments
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: expected a JSON document"),
        ("[" * 100_000, "expected a JSON document"),
        ("[]", "document: expected an object"),
        (changed(["format"], "else"), r"format: expected 'stepdiag-result', found \"else\""),
        (changed(["version"], 4), "version: expected 1, 2 or 3, found 4"),
        (changed(["version"], True), "version: expected 1, 2 or 3, found true"),
        (changed(["chain"], "XYZ"), "chain: expected X, Y, Z and the bed once each"),
        (
            changed(["volume", "size_mm"], [1, 2]),
            "volume.size_mm: expected three numbers, 0 for an axis without travel",
        ),
        (
            changed(["volume", "size_mm"], [1, 2, -1]),
            "volume.size_mm: expected three numbers, 0 for an axis without travel",
        ),
        (
            changed(["volume", "increments"], 2.5),
            "volume.increments: expected a whole number from 1 to 500",
        ),
        (changed(["errors", "EXY"], None), "errors.EXY: expected this entry, found nothing"),
        (changed(["errors", "EXQ"], {}), "errors.EXQ: expected a function named"),
        (changed(["errors", "EXY", "unit"], "mm"), "errors.EXY.unit: expected 'um'"),
        (changed(["errors", "EXY", "value"], [1.0]), "errors.EXY.value: expected 11 numbers"),
        (
            changed(["errors", "EXY", "value", 3], "a"),
            r"errors.EXY.value\[3\]: expected a finite number",
        ),
        (
            changed(["errors", "EXY", "position_mm", 3], 0.0),
            "errors.EXY.position_mm: expected at least two ascending positions",
        ),
        (
            changed(["errors", "EXY", "position_mm", 3], 80.0),
            "errors.EXY.position_mm: expected at least two ascending positions",
        ),
        (
            changed(
                ["errors", "EXY"], EMPTY | {"position_mm": [3.0], "value": [1.0], "u": [1.0]}
            ),
            "at least two ascending positions",
        ),
        (
            changed(["volume", "increments"], 0),
            "volume.increments: expected a whole number from 1 to 500",
        ),
        (
            changed(["volume", "increments"], 501),
            "volume.increments: expected a whole number from 1 to 500",
        ),
        (
            changed(["scale", "X", "identified"], True),
            "scale.X: expected a value if `identified` is true",
        ),
        (changed(["squareness", "B0Z"], None), "squareness.B0Z: expected this entry"),
        (
            changed(["findings", 0, "severity"], "bad"),
            r"findings\[0\].severity: expected info, warning or error",
        ),
        (TEXT.replace("500.0", "NaN", 1), "expected a finite number"),
    ],
)
def test_what_is_no_result_is_refused_by_field(text, message):
    with pytest.raises(DataError, match=message):
        parse_result(text, "old.json")


@pytest.mark.parametrize("part", ["offset", "modes", "rest", "between_um"])
@pytest.mark.parametrize("name", ["EX[", "E", "", "EXXX", "C0Z"])
def test_posterior_of_a_quantity_that_no_machine_has_is_refused(part: str, name: str) -> None:
    document = json.loads(solved(1).to_json())
    document["posterior"][part] = {name: next(iter(document["posterior"][part].values()), [])}
    with pytest.raises(DataError, match=f"posterior.{part}"):
        parse_result(json.dumps(document))
