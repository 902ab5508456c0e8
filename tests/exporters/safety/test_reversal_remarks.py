"""The backlash number is offered with its U, or not at all."""

from dataclasses import replace
from datetime import date

from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.checks import Case
from stepdiag.exporters.safety.remarks import remarks
from stepdiag.exporters.tables.curves import curves_of
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

PLAYING = made_result(reversal={"EXX": [8.0] * 5})


def said_of(result, code, direction="mean"):
    profile = profile_of("siemens", VOLUME, direction=direction)
    curves = curves_of(result, ["EXX"])
    case = Case(
        controller=controller_named("siemens"),
        profile=profile,
        result=result,
        curves=curves,
        tables=(),
        previous=(),
        today=date(2026, 6, 1),
    )
    return [finding.text for finding in remarks(case) if finding.code == code]


def test_the_backlash_number_comes_with_its_uncertainty():
    numbers = {"X": {"value": 8.21, "u": 0.2, "unit": "um"}}
    (text,) = said_of(replace(PLAYING, extra={"backlash": numbers}), "reversal-value")
    assert "-8.21 um" in text
    assert "U 0.40 um (k = 2)" in text


def test_without_a_common_zero_no_number_is_offered():
    assert said_of(PLAYING, "reversal-value") == []


def test_a_table_for_each_direction_is_not_written_for_chance():
    (text,) = said_of(made_result(reversal={"EXX": [0.5] * 5}), "reversal-insignificant", "both")
    assert text.startswith("EXX")
    assert said_of(PLAYING, "reversal-insignificant", "both") == []
