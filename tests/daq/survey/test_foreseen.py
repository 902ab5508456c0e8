"""What is said of a survey before it is driven."""

import re

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.completion.foreseen import circumstances, hidden_slip, hidden_waves
from stepdiag.daq.survey.file import parse_survey
from stepdiag.solver.planning.planner import forecast
from stepdiag.solver.planning.search import offered
from testkit.timeline import survey_text

FOUR = ("ppp", "npp", "pnp", "ppn")
TWICE = survey_text(setups=FOUR).replace("return_pass", "repeats = 2\nreturn_pass")


@pytest.mark.parametrize("n", [2, 5])
def test_a_survey_driven_once_is_told_the_slip_that_the_plan_foresees(n):
    survey = parse_survey(survey_text(n=n, setups=FOUR), "survey.toml")
    (said,) = hidden_slip(survey)
    ahead = forecast(survey.planned, circumstances(survey)).ahead
    # two increments check each other little: a slip stands out of four degrees of freedom
    assert 2.0 < ahead.unseen.half_um < (60.0 if n == 2 else 20.0)
    assert (
        f"a slip of {ahead.unseen.half_um:.2g} µm in the laser's count of a diagonal could stay"
        in said.text
    )
    assert f"cause an rms error of {ahead.unseen.volume_um:.2g} µm in the volume" in said.text
    assert "return_pass = true" in said.text


@pytest.mark.parametrize(
    "text", [survey_text(setups=FOUR, back=True), TWICE, survey_text(setups=("linear-x",))]
)
def test_nothing_is_said_where_a_slip_shows_or_no_diagonal_is_driven(text):
    assert not list(hidden_slip(parse_survey(text, "survey.toml")))


def with_pitch(pitch_mm, size_mm, n, feedback="screw"):
    text = (
        survey_text(n=n, setups=FOUR)
        + f'[uncertainty]\nfeedback = "{feedback}"\npitch_mm = {pitch_mm!r}\n'
    )
    survey = parse_survey(text, "survey.toml")
    return msgspec.structs.replace(
        survey, box=msgspec.structs.replace(survey.box, size_mm=size_mm)
    )


def test_targets_a_whole_number_of_turns_apart_are_named():
    (said,) = hidden_waves(with_pitch(10.0, (500.0, 430.0, 350.0), 10))
    assert (said.code, said.severity) == ("plan-hides", "info")
    assert (
        "with steps of x 50 mm, z 35 mm, the targets do not show errors that repeat with the "
        "screw pitch of 10 mm; set increments = 11 to" in said.text
    )


def test_runs_with_targets_of_their_own_show_the_waves_of_their_axis():
    survey = with_pitch(10.0, (500.0, 430.0, 350.0), 10)
    fine = msgspec.structs.replace(
        survey,
        plan=msgspec.structs.replace(survey.plan, setups=(*FOUR, "linear-x"), targets=40),
    )
    (said,) = hidden_waves(fine)
    assert "with steps of z 35 mm, the targets do not show" in said.text


@pytest.mark.parametrize(
    ("size_mm", "feedback"),
    [((430.0, 430.0, 430.0), "screw"), ((500.0, 500.0, 500.0), "scale")],
)
def test_other_steps_and_scales_are_not_named(size_mm, feedback):
    assert not list(hidden_waves(with_pitch(10.0, size_mm, 10, feedback)))


def test_a_file_that_states_no_pitch_is_not_asked():
    assert not list(hidden_waves(parse_survey(survey_text(n=5, setups=FOUR), "survey.toml")))


@given(st.floats(2.0, 50.0), st.floats(50.0, 5000.0), st.integers(1, 40))
def test_the_advised_number_of_increments_shows_the_waves(pitch_mm, edge_mm, n):
    for said in hidden_waves(with_pitch(pitch_mm, (edge_mm,) * 3, n)):
        if advised := re.search(r"increments = (\d+)", said.text):
            assert not list(
                hidden_waves(with_pitch(pitch_mm, (edge_mm,) * 3, int(advised[1])))
            )


@pytest.mark.parametrize(
    ("head", "turns", "runs"),
    [
        (
            'format = "fourdof"\nid = "A"\ncalibration = "a.toml"\n',
            "EBX ECX EAY ECY EAZ EBZ",
            "xyz",
        ),
        ('format = "tqd"\nid = "A"\ncalibration = "a.toml"\n', "", ""),
        (
            'format = "elcomat"\n[head.angles]\nx = ["+B", "-C"]\nz = ["+A"]\nu_urad = 0.2\n',
            "EBX ECX EAZ",
            "xz",
        ),
        ('format = "wyler"\n[head.angles]\nx = ["+A"]\nu_urad = 2.0\n', "EAX", "x"),
    ],
)
def test_the_plan_counts_what_the_instrument_of_the_survey_measures(head, turns, runs):
    """An autocollimator or a level along the axes that the file names; a quadrant detector alone
    measures no angle."""
    survey = parse_survey(
        survey_text(setups=FOUR) + f'[head]\nport = "/dev/null1"\n{head}', "survey.toml"
    )
    about = circumstances(survey)
    assert about.head_turns == tuple(turns.split())
    measured = [run for run in offered(survey.planned, about) if run.is_fourdof]
    assert "".join(run.setup[-1] for run in measured) == runs
    known = about.head_ranges_urad(measured)
    u_urad = survey.head.angles.u_urad if survey.head.angular else 1.0
    assert set(known) == set(turns.split())
    assert all(size == pytest.approx(2.0 * u_urad) for size in known.values())
