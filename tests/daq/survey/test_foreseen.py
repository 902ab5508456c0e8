"""What is said of a survey before it is driven."""

import pytest

from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.foreseen import circumstances, hidden_slip, planned
from stepdiag.solver.planning.planner import forecast
from testkit.timeline import survey_text

FOUR = ("ppp", "npp", "pnp", "ppn")
TWICE = survey_text(setups=FOUR).replace("return_pass", "repeats = 2\nreturn_pass")


@pytest.mark.parametrize("n", [2, 5])
def test_a_survey_driven_once_is_told_the_slip_that_the_plan_foresees(n):
    survey = parse_survey(survey_text(n=n, setups=FOUR), "survey.toml")
    (said,) = hidden_slip(survey)
    ahead = forecast(planned(survey), circumstances(survey)).ahead
    assert 2.0 < ahead.unseen.half_um < 10.0
    assert f"a slip of the laser's count of {ahead.unseen.half_um:.2g} um could hide" in said.text
    assert f"make {ahead.unseen_volume_um:.2g} um of the volume's errors" in said.text
    assert "return_pass = true" in said.text


@pytest.mark.parametrize("text", [survey_text(setups=FOUR, back=True), TWICE, survey_text(setups=("linear-x",))])
def test_nothing_is_said_where_a_slip_shows_or_no_diagonal_is_driven(text):
    assert not list(hidden_slip(parse_survey(text, "survey.toml")))
