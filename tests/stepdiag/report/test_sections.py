"""Tables of the report that a result fills by itself."""

from dataclasses import replace

import pytest

from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import StandardFigures
from stepdiag.report.certificate import bound_words, interval_words
from stepdiag.report.document import build_report
from stepdiag.report.sections import (
    lengths_table,
    positioning_lengths,
    positioning_table,
    setups_table,
    slips_table,
    vdi_table,
)
from stepdiag.texts.texts import LANGUAGES, catalogue
from testkit.exact.madeup import made_up_result
from testkit.exact.members import members, setups

SCALES = {axis: {"value": 1.0, "u": 0.5} for axis in "XYZ"}
WARM = {axis: {"value": 41.95, "u": 0.5} for axis in "XYZ"}
ISO = {
    "standard": "ISO 230-2:2014",
    "lengths": "as measured",
    "runs": 5,
    "E": 7.0,
    "B": 3.0,
    "U": {"E": 1.0, "B": 0.5},
}
VDI = {
    "standard": "VDI/DGQ 3441:1977",
    "P": 7.5,
    "Pa": 4.0,
    "U_max": 3.0,
    "U_mean": 2.9,
    "Ps_max": 0.4,
    "Ps_mean": 0.3,
}


def standards_of(given: dict[str, object]) -> dict[str, tuple[StandardFigures, ...]]:
    """Return figures of the standards from their JSON, with what every figure has."""
    rows = {
        name: [{"source_status": "", **one} for one in found]
        if isinstance(found, list)
        else found
        for name, found in given.items()
    }
    return members(standards=rows)["standards"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_lengths_stand_both_ways_and_those_in_the_tables_are_marked(language):
    words = {**catalogue("common", language), **catalogue("report", language)}
    extra = {
        "lengths": {
            "tables": "at_20_c",
            "material_c": [23.5] * 3,
            "at_20_c": SCALES,
            "as_measured": WARM,
        }
    }
    table = lengths_table(replace(made_up_result(), **members(**extra)), words)
    assert table.rows[0] == ("X", "42.0 ± 1.0", "1.0 ± 1.0")
    marked = [words["in_tables"] in heading for heading in table.header]
    assert marked == [False, False, True]
    assert lengths_table(made_up_result(), words) is None


def test_linear_figures_stand_with_u_and_the_lengths_they_are_of_are_said_once():
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    standards = standards_of({"linear-x": [ISO, VDI], "linear-y": [ISO]})
    row, _ = positioning_table(standards, words, "en").rows
    assert row == (
        "linear run X (linear-x)",
        "ISO 230-2:2014",
        "5",
        "7.0 ± 1.0",
        "3.00 ± 0.50",
    )
    assert positioning_lengths(standards, words) == "lengths as measured"
    assert (
        positioning_lengths(standards_of({"linear-x": [VDI]}), words)
        == positioning_lengths({}, words)
        == ""
    )


def test_lengths_that_differ_stand_in_the_rows_they_are_of():
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    standards = standards_of({"linear-x": [ISO], "linear-y": [{**ISO, "lengths": "at 20 C"}]})
    assert [row[1] for row in positioning_table(standards, words, "en").rows] == [
        "ISO 230-2:2014, lengths as measured",
        "ISO 230-2:2014, lengths at 20 °C",
    ]
    assert positioning_lengths(standards, words) == ""


def test_figures_along_a_diagonal_stand_beside_its_corners():
    words = {**catalogue("common", "de"), **catalogue("report", "de")}
    (row,) = positioning_table(standards_of({"npp": [ISO]}), words, "de").rows
    assert row[0] == "Diagonale X+Y-Z- nach X-Y+Z+ (npp)"


def test_vdi_3441_stands_beside_where_a_run_has_it():
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    (row,) = vdi_table(
        standards_of({"linear-x": [ISO, VDI], "linear-y": [ISO]}), words, "en"
    ).rows
    assert row == (
        "linear run X (linear-x)",
        "VDI/DGQ 3441:1977",
        "7.50",
        "4.00",
        "3.00",
        "2.90",
        "0.40",
        "0.30",
    )
    neither = standards_of({"linear-y": [ISO], "linear-z": "nonsense"})
    assert vdi_table(neither, words, "en") is None


def test_the_largest_vector_is_a_bound() -> None:
    """As the conclusion says it: at most. How small it may be is no promise; without an interval it
    is at least what was found."""
    sure = Interval(value_um=4.4, low_um=3.0, high_um=6.2)
    assert (bound_words(sure), interval_words(sure)) == ("≤ 6.2", "3.0 … 6.2")
    assert (
        bound_words(Interval(value_um=4.4))
        == interval_words(Interval(value_um=4.4))
        == "≥ 4.4"
    )
    assert bound_words(None) == "–"


SLIP = {
    "setup": "npp",
    "pass": 1,
    "stop": 4,
    "half_um": 2.5,
    "nearly_um": 4.0,
    "volume_um": 1.2,
}


def test_what_a_slip_could_hide_stands_with_its_place_and_with_what_it_does_to_the_volume():
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    blind = {
        **SLIP,
        "setup": "linear-x",
        "half_um": None,
        "nearly_um": None,
        "volume_um": None,
    }
    result = replace(
        made_up_result(), **members(unseen_slip={"diagonals": SLIP, "runs": blind})
    )
    assert slips_table(result, words, "en").rows == [
        ("diagonal X+Y-Z- to X-Y+Z+ (npp), pass 1 out, stop 5", "2.5", "4.0", "1.2"),
        ("linear run X (linear-x), pass 1 out, stop 5", "–", "–", "–"),
    ]
    assert slips_table(made_up_result(), words, "en") is None
    assert (
        slips_table(
            replace(
                made_up_result(), **members(unseen_slip={"diagonals": "nonsense", "runs": {}})
            ),
            words,
            "en",
        )
        is None
    )
    assert "(npp), pass 1 out, stop 5" in build_report(result, source="result.json").html


def test_a_column_that_no_setup_fills_is_left_out():
    """Without a way back no drift is known: the column stood there empty."""
    words = {**catalogue("common", "en"), **catalogue("report", "en")}
    once = setups(
        ppp={"drift": [], "residual_um": 0.1}, npp={"drift": [], "residual_um": 0.2}
    )
    assert setups_table(replace(made_up_result(), setups=once), words, "en").header == (
        words["setup"],
        "residual / µm",
    )
    drift = {"pair": 1, "rate": 0.5, "unit": "um/stop", "total_um": 0.5, "u_um": 0.1}
    both = {**once, **setups(npp={"drift": [drift], "residual_um": 0.2})}
    rows = setups_table(replace(made_up_result(), setups=both), words, "en").rows
    assert [row[1] for row in rows] == ["–", "0.50 ± 0.10 µm"]
