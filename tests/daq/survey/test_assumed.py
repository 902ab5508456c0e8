"""What a survey takes for granted: by class of machine, as stated, and by the certificates of the
air's sensors."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conditions.assumptions import CLASSES, FEEDBACKS, Assumptions, usual_sizes
from stepdiag.base.errors import UsageError
from stepdiag.daq.survey.assumed import assumptions_of, parse_uncertainty
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.template import template

STATED = st.dictionaries(st.sampled_from(sorted(usual_sizes())), st.floats(0.001, 1000.0))


@given(st.sampled_from(sorted(CLASSES)), st.sampled_from(sorted(FEEDBACKS)), STATED)
def test_a_stated_size_takes_the_place_of_that_of_the_class(machine, feedback, stated):
    lines = [
        f'machine_class = "{machine}"',
        f'feedback = "{feedback}"',
        *(f"{name} = {size!r}" for name, size in stated.items()),
    ]
    found = asdict(parse_uncertainty("[uncertainty]\n" + "\n".join(lines) + "\n", "u.toml"))
    assert {name: found[name] for name in usual_sizes()} == usual_sizes(
        machine, feedback
    ) | stated


def test_a_section_without_sizes_is_an_ordinary_machine_with_screws():
    assert parse_uncertainty("[uncertainty]\n", "u.toml") == Assumptions()


def test_a_size_of_zero_is_stated():
    assert parse_uncertainty("[uncertainty]\ndrift_um = 0\n", "u.toml").drift_um == 0.0


def test_the_template_shows_the_sizes_of_its_class():
    text = template()
    for name, size in usual_sizes().items():
        assert f"\n#{name} = {size}\n" in text
    assert assumptions_of(parse_survey(text, "s")) == assumptions_of(
        parse_survey(text.replace("\n#angles_urad", "\nangles_urad"), "s")
    )


@pytest.mark.parametrize(
    "line",
    [
        'machine_class = "excellent"',
        'feedback = "encoder"',
        "pitch_mm = 0",
        "growth_um_m = -1",
    ],
)
def test_a_class_or_size_that_does_not_exist_is_refused(line):
    with pytest.raises(UsageError, match=line.split(" ", maxsplit=1)[0]):
        parse_uncertainty(f"[uncertainty]\n{line}\n", "u.toml")


def test_without_certificates_the_assumed_index_stands():
    assert parse_uncertainty(
        "[uncertainty]\nindex_ppm = 0.4\n", "u.toml"
    ).index == pytest.approx(4e-7)


def test_sensors_take_the_place_of_the_assumed_index():
    """1 C makes 0.95 ppm, 3.7 hPa 1 ppm (Edlen's equation at 20 C): both together, and the laser's
    own 0.1 ppm."""
    text = (
        "[uncertainty]\nindex_ppm = 9.0\nu_air_temperature_c = 0.2\nu_air_pressure_hpa = "
        "0.74\nu_laser_ppm = 0.1\n"
    )
    expected = (0.19**2 + 0.2**2 + 0.1**2) ** 0.5 * 1e-6
    assert parse_uncertainty(text, "u.toml").index == pytest.approx(expected, rel=0.03)
