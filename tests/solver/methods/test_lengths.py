"""Lengths as measured and at 20 C: both with U, never mixed, against machines whose warmth is known
exactly."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.conditions.expansion import expansion_um
from stepdiag.base.errors import DataError
from stepdiag.base.findings import in_words
from stepdiag.base.readings.readings import parse_readings, render_readings
from stepdiag.base.result.basis import basis_of
from stepdiag.base.result.result import ROTATIONS, Function, Scale, parse_result
from stepdiag.base.result.typed import written
from stepdiag.daq.survey.assumed import parse_uncertainty
from stepdiag.solver.methods.lengths import at_their_temperature, lengths_report, tool_report
from stepdiag.solver.methods.solve import solve
from testkit.exact.surveys import Bench

WARM_C = 27.0
STEEL = 11.7
BENCH = Bench(seed=5, increments=4, angle_urad=0.0)


def readings(bench=BENCH, warm_c=WARM_C, *, reduced=False):
    """A survey of a machine whose scales are at 20 C what its truth says and have grown since;
    perhaps brought back to 20 C."""
    made = bench.survey(passes=(1,))
    count = len(made)
    if reduced:
        return replace(
            made, temperature_c=np.full(count, warm_c), at_20_c=np.ones(count, dtype=bool)
        )
    grown = np.empty(count)
    for rows in made.passes().values():
        travel = made.position_mm[rows] - made.position_mm[rows[0]]
        along = travel[-1] / np.linalg.norm(travel[-1])
        grown[rows] = expansion_um(travel, along, (STEEL,) * 3, (warm_c,) * 3)
    return replace(
        made, reading_mm=made.reading_mm + 1e-3 * grown, temperature_c=np.full(count, warm_c)
    )


@pytest.fixture(scope="module")
def both():
    return solve(readings()), solve(readings(reduced=True))


def test_each_way_says_both_lengths_and_both_hold_the_truth(both):
    """7 C of 11.7 µm/m/C are 81.9 µm/m; whichever way the readings came, 2 u hold the truth at both
    temperatures."""
    for result in both:
        lengths = written(result.lengths)
        for axis, letter in enumerate("XYZ"):
            function = BENCH.truth.errors[f"E{letter}{letter}"]
            at_20 = 1e3 * (function[-1] - function[0]) / BENCH.size_mm[axis]
            for name, true in (("at_20_c", at_20), ("as_measured", at_20 + 7.0 * STEEL)):
                found = lengths[name][letter]
                assert abs(found["value"] - true) <= 2.5 * found["u"], (name, letter)
    as_measured, reduced = both
    assert (as_measured.lengths.tables, reduced.lengths.tables) == ("as_measured", "at_20_c")


def test_the_tables_correct_what_is_said_and_the_others_carry_the_material(both):
    """u at 20 C holds 0.3 C of 11.7 µm/m/C and 1 µm/m/C of 7 C: 7.8 µm/m; as measured neither
    (theory 8.7)."""
    for result, here, other in (
        (both[0], "as_measured", "at_20_c"),
        (both[1], "at_20_c", "as_measured"),
    ):
        lengths = written(result.lengths)
        for letter, scale in result.scale.items():
            assert lengths[here][letter]["value"] == scale.value
            assert lengths[here][letter]["u"] == scale.u
        material = np.hypot(0.3 * STEEL, 7.0)
        for letter in "XYZ":
            wide, narrow = (lengths[name][letter]["u"] for name in ("at_20_c", "as_measured"))
            assert wide**2 - narrow**2 == pytest.approx(material**2, rel=0.02)
        assert other in lengths


def test_readings_that_were_brought_to_20_c_say_so_in_their_file(both):
    """A CSV of reduced readings solved anew is not levelled again, and its U does not lose the
    material's part."""
    text = render_readings(readings(reduced=True))
    again = parse_readings(text)
    assert again.at_20_c.all()
    assert render_readings(again) == text
    assert "at_20_c" not in render_readings(readings())
    result = solve(again)
    assert result.lengths.tables == "at_20_c"
    for letter, scale in both[1].scale.items():
        # the file's rounding moves the sizes that are found a little: a hundredth of u
        assert result.scale[letter].value == pytest.approx(scale.value, abs=0.01 * scale.u)
        assert result.scale[letter].u == pytest.approx(scale.u, rel=0.01)


def test_readings_at_both_temperatures_are_never_mixed():
    mixed = readings(reduced=True)
    mixed.at_20_c[7] = False
    with pytest.raises(
        DataError,
        match=r"mine\.csv: setup \w+, pass 1, stop \d+: expected at_20_c = 1 in "
        r"every row, as in the other rows",
    ):
        solve(mixed, source="mine.csv")
    with pytest.raises(DataError, match=r"at_20_c: expected 1 or 0, found 'yes'"):
        parse_readings(
            "setup,pass,stop,x_mm,y_mm,z_mm,reading_mm,at_20_c\nppp,1,0,0,0,0,0,yes\n"
        )


def test_what_nobody_measured_is_not_20_c():
    """Without a thermometer the lengths at 20 C are not known, however near 20 C the usual default
    is."""
    made = readings()
    result = solve(replace(made, temperature_c=np.full(len(made), np.nan)))
    lengths = written(result.lengths)
    assert lengths["material_c"] is None
    assert all(
        entry["value"] is None and entry["u"] is None for entry in lengths["at_20_c"].values()
    )
    basis = basis_of(parse_result(result.to_json()))
    assert (basis.tables, basis.material_c, basis.other) == ("as_measured", None, ())
    assert len(basis.scales) == 3


@pytest.mark.parametrize(("reduced", "severity"), [(False, "info"), (True, "warning")])
def test_a_temperature_that_nobody_measured_is_said(reduced, severity, both):
    """As measured it says for what the lengths hold; brought to 20 C, what was assumed for it is in
    U: 3.5 C of 11.7 µm/m/C."""
    made = readings(reduced=reduced)
    result = solve(replace(made, temperature_c=np.full(len(made), np.nan)))
    assert [one.severity for one in result.findings if one.code == "material-unmeasured"] == [
        severity
    ]
    assert not [one for one in both[reduced].findings if one.code == "material-unmeasured"]
    for letter, scale in result.scale.items():
        known = both[reduced].scale[letter].u if reduced else scale.u
        assert (scale.u > 3.5 * STEEL) is reduced
        assert known < 10.0


@pytest.mark.parametrize("stated_c", [1.0, 6.0])
def test_what_the_user_states_of_the_temperature_stands_and_is_said(stated_c):
    """Smaller or larger than the 3.5 C that stand for a temperature that nobody measured; the
    template's value is no statement."""
    made = readings(reduced=True)
    blind = replace(made, temperature_c=np.full(len(made), np.nan))
    stated = parse_uncertainty(f"[uncertainty]\nu_material_c = {stated_c}\n", "u.toml")
    result = solve(blind, assumed=stated)
    (said,) = [one for one in result.findings if one.code == "material-unmeasured"]
    assert said.severity == "warning"
    assert f"is {stated_c:.2g} C (k = 1), the value of u_material_c" in said.text
    assert "der Wert von u_material_c" in in_words(said, "de")
    assert result.assumed.u_material_c == stated_c
    for scale in result.scale.values():
        assert stated_c * STEEL < scale.u < np.hypot(stated_c * STEEL, 10.0)
    template = parse_uncertainty("[uncertainty]\nu_material_c = 0.3\n", "u.toml")
    assert at_their_temperature(blind, template, "readings").u_material_c == 3.5


def test_a_temperature_of_some_readings_is_none_of_the_survey():
    made = readings(reduced=True)
    some = made.temperature_c.copy()
    some[::2] = np.nan
    assert at_their_temperature(
        replace(made, temperature_c=some), None, "readings"
    ).u_material_c == pytest.approx(3.5)


def test_a_scale_that_is_not_identified_has_no_length_anywhere():
    scales = {letter: Scale(value=None, u=None, identified=False) for letter in "XYZ"}
    report = written(lengths_report(scales, Assumptions(material_c=(25.0,) * 3), known=True))
    assert all(
        entry["value"] is None
        for name in ("as_measured", "at_20_c")
        for entry in report[name].values()
    )


def test_the_uncertainty_of_the_material_counts_from_the_temperature_that_was_measured():
    """The survey file's 20 C is no measurement: 1 µm/m/C of 7 C counts, wherever the file
    stands."""
    found = at_their_temperature(readings(reduced=True), Assumptions(), "readings")
    assert found.material_c == pytest.approx((WARM_C,) * 3)
    assert found.reduced_to_20_c


def test_the_tool_offset_is_said_to_be_zero_with_what_that_may_cost():
    """Three angular functions of 10 urad at most with U 2 and six that nobody knows within 10 (k =
    1): 0.1 m of sqrt(3 12^2 + 6 20^2)."""
    position = np.linspace(0.0, 100.0, 3)
    known = {
        name: Function(
            position_mm=position,
            value=np.array([0.0, 4.0, -10.0]),
            u=np.full(3, 1.0),
            unit="urad",
        )
        for name in ROTATIONS[:3]
    }
    report = tool_report(known, {}, Assumptions(angles_urad=10.0))
    assert report.offset_mm == (0.0, 0.0, 0.0)
    assert report.up_to_um_per_100_mm == pytest.approx(
        0.1 * np.sqrt(3 * 12.0**2 + 6 * 20.0**2)
    )
