"""The verdict where a person or a program meets it: conclusion, messages, OPC UA."""

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Judged
from stepdiag.base.result.result import Result
from stepdiag.conclusion import (
    Export,
    Reach,
    conclude,
    conclusion_document,
    conclusion_json,
    judged_in,
    words_of,
)
from stepdiag.conclusion.verdict import probability_words
from stepdiag.daq.survey.assumed import parse_tolerance
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.template import template
from stepdiag.publish.messages import ResultMessage, Watched
from testkit.exact.surveys import solved

TOLERANCE = {"volumetric_rms_um": 1.0, "squareness_urad": 500.0}


@pytest.fixture
def judged() -> Result:
    return with_tolerance(solved(1), TOLERANCE)


def test_conclusion_holds_the_verdict_in_both_languages(judged: Result) -> None:
    document = conclusion_document(conclude(judged))
    english, german = (words_of(document, language)["verdict"] for language in ("en", "de"))
    assert english[0] == "As found: not conform."
    assert english[1].endswith(
        "tolerance 1 µm: not conform; probability of conformity < 1 %."
    )
    assert german[0] == "Vorgefunden: nicht konform."
    assert "Toleranz 500 µrad: konform; Konformitätswahrscheinlichkeit > 99 %." in german[2]
    assert "After compensation, predicted:" in english[5]


def test_printed_interval_is_that_of_the_reach(judged: Result) -> None:
    words = words_of(conclusion_document(conclude(judged)), "en")
    low, high = judged.predicted.without_rigid_motion["before"].rms_um.shown()
    assert f"{low} to {high} µm" in words["reached"][0]
    assert f"{low} to {high} µm" in words["verdict"][1]


def test_files_of_an_export_decide_what_is_predicted(judged: Result) -> None:
    small, large = (
        Interval(value_um=v, low_um=0.9 * v, high_um=1.1 * v, within=float(v < 1))
        for v in (0.5, 2.0)
    )
    reach = Reach(
        rms_before=large, largest_before=large, rms_after=small, largest_after=small
    )
    assert [one.verdict for one in judged_in(judged, reach).predicted] == ["conform"]
    assert [
        one.verdict for one in judged_in(judged, replace(reach, rms_after=large)).predicted
    ] == ["not_conform"]
    assert (
        conclude(judged, [Export(controller="siemens", reach=reach)])
        .verdict[-1]
        .arguments["limit"]
        == "1"
    )


def test_without_a_tolerance_there_is_no_word_of_it() -> None:
    for word in ("verdict", "within", "oleran"):
        assert word not in conclusion_json(conclude(solved(1)))


@pytest.mark.parametrize(("p", "words"), [(1.0, "> 99"), (0.0, "< 1"), (0.664, "66")])
def test_probability_is_no_surer_than_draws(p: float, words: str) -> None:
    assert probability_words(p) == words


def test_tolerance_of_the_template_is_that_of_a_file() -> None:
    """Switching the section on states every tolerance; as the template stands it states none."""
    assert (
        parse_survey(
            template().replace('compensation = "?"', 'compensation = "off"'), "s"
        ).tolerance.by_quantity()
        == {}
    )
    section = template()[
        template().index("#[tolerance]") : template().index("# Compensation files to write")
    ]
    switched = "\n".join(
        line.removeprefix("#") if line.startswith("#") and line[1] != " " else line
        for line in section.splitlines()
    )
    assert set(parse_tolerance(switched, "t")) == {
        "volumetric_rms_um",
        "volumetric_largest_um",
        "squareness_urad",
        "positioning_e_um",
        "positioning_a_um",
        "EYX",
        "EBX",
    }


def test_message_of_a_result_holds_every_judged_figure(
    judged: Result, tmp_path: Path
) -> None:
    (tmp_path / "0001").mkdir()
    (tmp_path / "0001" / "result.json").write_text(judged.to_json(), encoding="utf-8")
    survey = parse_survey(
        template().replace('compensation = "?"', 'compensation = "off"'), "s"
    )
    result = next(
        one for one in Watched(survey, tmp_path).now() if isinstance(one, ResultMessage)
    )
    assert [one.quantity for one in result.conformity] == [
        "volumetric_rms",
        "C0Y",
        "B0Z",
        "A0Z",
    ]
    assert msgspec.json.decode(msgspec.json.encode(result), type=ResultMessage) == result
    assert isinstance(judged.conformity.as_found[0], Judged)


def test_evaluation_of_opc_ua_follows_the_verdict() -> None:
    station = pytest.importorskip("stepdiag.publish.station")
    assert station.EVALUATED == {
        "": "Undefined",
        "conform": "OK",
        "not_conform": "NotOK",
        "not_decidable": "NotDecidable",
    }
