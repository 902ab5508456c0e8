"""The backlash number is offered with its U and with where it goes, or not at all."""

from dataclasses import replace
from datetime import date

import msgspec
import pytest

from stepdiag.base.result.result import Result
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.checks import Case
from stepdiag.exporters.safety.remarks import remarks
from stepdiag.exporters.tables.curves import curves_of
from testkit.exact.machines import profile_of
from testkit.exact.members import members
from testkit.exact.results import VOLUME, made_result

PLAYING = made_result(reversal={"EXX": [8.0] * 5})
NUMBERS = {"X": {"value": 8.21, "u": 0.2, "unit": "um"}}
KNOWN = replace(PLAYING, **members(backlash=NUMBERS))


def said_of(
    result: Result, code: str, direction: str = "mean", name: str = "siemens", **axis: object
) -> list[str]:
    profile = profile_of(name, VOLUME, direction=direction)
    profile = replace(
        profile,
        axes={
            letter: msgspec.structs.replace(each, **axis)
            for letter, each in profile.axes.items()
        },
    )
    curves, control = curves_of(result, ["EXX"]), controller_named(name)
    tables = control.plan(curves, profile).tables
    case = Case(
        controller=control,
        profile=profile,
        result=result,
        curves=curves,
        tables=tables,
        previous=(),
        today=date(2026, 6, 1),
    )
    return [finding.text for finding in remarks(case) if finding.key == code]


def test_the_backlash_number_comes_with_its_uncertainty():
    (text,) = said_of(KNOWN, "reversal-value")
    assert "-8.21 µm" in text
    assert "U 0.40 µm (k = 2)" in text


def test_it_comes_on_top_of_what_the_parameter_held_while_measuring():
    """Measured with 5 µm at work, 8.21 µm less are asked for: who enters the number alone takes the
    5 µm away."""
    (text,) = said_of(KNOWN, "reversal-value")
    assert text.endswith("that the backlash parameter had during the measurement")
    assert said_of(KNOWN, "reversal-value", backlash_um=5.0) == [text], (
        "what the control holds now may have the number in it already"
    )


@pytest.mark.parametrize("backlash_um", [0.0, 5.0])
def test_where_a_table_ends_the_parameter_the_number_goes_into_the_table(backlash_um):
    """LinuxCNC looks at BACKLASH only where there is no COMP_FILE; what BACKLASH held is in the
    columns already."""
    (text,) = said_of(KNOWN, "reversal-value", name="linuxcnc", backlash_um=backlash_um)
    assert text.endswith(
        'direction = "both" writes the backlash into the table, and the backlash parameter has '
        "no effect beside this table"
    )
    assert said_of(KNOWN, "reversal-value", "both", "linuxcnc", backlash_um=backlash_um) == []


@pytest.mark.parametrize("name", ["heidenhain", "mitsubishi"])
def test_a_control_that_holds_the_mean_only_is_told_the_number_whatever_was_asked(name):
    (text,) = said_of(KNOWN, "reversal-value", "both", name)
    assert "U 0.40 µm (k = 2)" in text


def test_a_table_for_each_direction_leaves_nothing_for_the_parameter():
    assert said_of(KNOWN, "reversal-value", "both", backlash_um=0.0) == []


def test_a_number_that_is_chance_is_not_offered():
    """A reversal of +8 at one end and -8 at the other is significant, its mean is nothing."""
    chance = replace(
        PLAYING, **members(backlash={"X": {"value": 0.4, "u": 0.2, "unit": "um"}})
    )
    assert said_of(chance, "reversal-value") == []


def test_without_a_common_zero_no_number_is_offered():
    assert said_of(PLAYING, "reversal-value") == []


def test_the_kinematics_component_leaves_it_to_backlash_with_the_number(tmp_path):
    profile = profile_of("linuxcnc", VOLUME)
    options = msgspec.structs.replace(profile.options, way="kinematics")
    report = export(
        KNOWN, "linuxcnc", replace(profile, options=options), out_dir=tmp_path / "out"
    )
    (text,) = (finding.text for finding in report.findings if finding.key == "reversal-value")
    assert text.endswith("that the backlash parameter had during the measurement")


def test_a_table_for_each_direction_is_not_written_for_chance():
    (text,) = said_of(
        made_result(reversal={"EXX": [0.5] * 5}), "direction-averaged.chance", "both"
    )
    assert text.startswith("EXX")
    assert said_of(PLAYING, "direction-averaged.chance", "both") == []
