"""One scale on every axis: a wrong statement, or the machine, and the reading that tells."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag.completion.one_scale import one_scale
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import survey_file

WARM_C = 30.07
EXPANSION_UM_M = -11.7 * (WARM_C - 20.0)
AIR_UM_M = 271.4


def named(values, *, expands=False, compensated=True, warm_c=WARM_C):
    """Return the line and the reading that are named for these scales in µm/m, if any."""
    text = survey_file(compensated=compensated)
    if expands:
        text = text.replace("[machine]\n", "[machine]\napply_expansion = true\n", 1)
    scales = {
        axis: SimpleNamespace(value=float(value), u=11.0)
        for axis, value in zip("XYZ", values, strict=True)
    }
    result = SimpleNamespace(scale=scales, lengths=SimpleNamespace(material_c=(warm_c,) * 3))
    return [
        (
            found.severity,
            found.message.arguments["line"],
            found.message.arguments["reading"].key,
        )
        for found in one_scale(parse_survey(text, "survey.toml"), result)
    ]


@pytest.mark.parametrize("own_um_m", [0.0, 20.0, 30.0])
def test_scales_of_machine_and_expansion_alike_are_doubted_with_the_reading_that_tells(
    own_um_m,
):
    values = np.array([4.0, -7.0, 1.0]) + EXPANSION_UM_M + own_um_m
    expected = ("error", "machine.apply_expansion", "reading-expansion")
    assert named(values, expands=True) == [expected]


@pytest.mark.parametrize(("warm_c", "most_silent"), [(28.0, 15), (20.5, 200)])
def test_expansion_twice_is_doubted_with_ordinary_scales_in_any_warmth(warm_c, most_silent):
    """Half a degree is nothing that scales show; from eight on few machines hide it."""
    own_um_m = np.random.default_rng(7432).normal(0.0, 25.0, (200, 3))
    twice = own_um_m - 11.7 * (warm_c - 20.0)
    silent = [named(values, expands=True, warm_c=warm_c) for values in twice].count([])
    assert silent <= most_silent
    false = [values for values in own_um_m if named(values, expands=True, warm_c=warm_c)]
    assert len(false) <= 1


@pytest.mark.parametrize(("compensated", "sign"), [(True, 1), (False, -1)])
def test_air_and_a_long_machine_alike_are_doubted(compensated, sign):
    values = sign * (AIR_UM_M + np.array([-65.0, -75.0, -60.0]))
    expected = ("error", "laser.compensated", "reading-air")
    assert named(values, compensated=compensated) == [expected]


@pytest.mark.parametrize("compensated", [True, False])
def test_a_machine_as_long_as_an_expansion_is_not_doubted_without_its_statement(compensated):
    """The file does not bring readings to 20 °C, so that nothing is done twice."""
    for sign in (1, -1):
        values = sign * (EXPANSION_UM_M + np.array([4.0, -7.0, 1.0]))
        assert named(values, compensated=compensated) == []


def test_drawn_machines_with_scales_of_200_um_m_are_not_doubted():
    rng = np.random.default_rng(7430)
    drawn = [named(values) for values in rng.uniform(-200.0, 200.0, (40, 3))]
    assert drawn == [[]] * 40


def test_a_warm_machine_of_ordinary_scales_is_not_doubted():
    rng = np.random.default_rng(7431)
    drawn = [named(values, expands=True) for values in rng.normal(0.0, 25.0, (40, 3))]
    assert drawn == [[]] * 40
