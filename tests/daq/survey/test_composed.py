"""A survey file from a first survey's answers."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.conditions.assumptions import CLASSES, FEEDBACKS
from stepdiag.base.errors import UsageError
from stepdiag.base.readings.runs import run_stops_mm
from stepdiag.base.volume import in_step
from stepdiag.completion.foreseen import hidden_waves
from stepdiag.daq.survey.composed import (
    Answers,
    MachineClass,
    begun,
    composed,
    increments_for,
)
from stepdiag.daq.survey.controls import CONTROLS
from stepdiag.daq.survey.file import parse_survey

LENGTH = st.floats(20.0, 5000.0)


@settings(max_examples=20)
@given(
    st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), min_size=1, max_size=60),
    st.tuples(LENGTH, LENGTH, LENGTH),
    st.sampled_from([*CONTROLS, "none"]),
    st.sampled_from(["umd", "nd", "ids3010", "lasertex", "qudis"]),
    st.sampled_from([0, 1502, 65535]),
)
def test_every_answer_that_can_be_given_is_read_back(machine, size, control, form, port):
    answers = Answers(
        name="mill",
        machine=machine,
        size_mm=size,
        laser_port="/dev/ttyUSB0",
        laser_format=form,
        control=control,
        host="h",
        tcp_port=port,
    )
    survey = parse_survey(composed(answers, "mill.toml"), "mill.toml")
    assert (survey.identity.machine, survey.box.size_mm, survey.laser.format) == (
        machine,
        size,
        form,
    )
    assert survey.plc.silent == (control == "none")
    if control != "none":
        assert survey.plc.port == (port or None)
    assert survey.environment.source == (
        "laser"
        if form in ("ids3010", "lasertex")
        else "plc"
        if control == "modbus"
        else "fixed"
    )
    assert survey.laser.baud == (3_000_000 if form == "lasertex" else 115200)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("machine", "two\nlines"),
        ("chain", "XYZ"),
        ("size_mm", (0.5, 0.4, 0.3)),
        ("laser_port", ""),
        ("control", "../../x"),
    ],
)
def test_an_answer_that_no_survey_can_have_is_refused(field, value):
    answers = {
        "name": "s",
        "machine": "m",
        "size_mm": (1e3, 1e3, 1e3),
        "laser_port": "p",
        "laser_format": "umd",
        "control": "none",
    }
    with pytest.raises(UsageError):
        composed(Answers(**answers | {field: value}), "s.toml")


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("feedback", FEEDBACKS)
def test_a_class_of_machine_reaches_both_files(name, feedback):
    usual = MachineClass(name=name, feedback=feedback, pitch_mm=16)
    answers = Answers(
        name="s",
        machine="m",
        size_mm=(1e3, 1e3, 1e3),
        laser_port="p",
        laser_format="umd",
        control="none",
        usual=usual,
    )
    for text in (begun(usual, "s.toml"), composed(answers, "s.toml")):
        section = parse_survey(text, "s.toml").uncertainty
        assert (section.machine_class, section.feedback, section.pitch_mm) == (
            name,
            feedback,
            16.0,
        )
        assert section.angles_urad is None


def test_a_new_survey_alternates_its_orders_and_has_fine_irregular_runs():
    """By `init` and by the wizard; a file without these lines is driven as before."""
    answers = Answers(
        name="a",
        machine="m",
        size_mm=(500.0, 400.0, 300.0),
        laser_port="/dev/x",
        laser_format="umd",
        control="none",
    )
    for text in (begun(MachineClass(), "s.toml"), composed(answers, "s.toml")):
        survey = parse_survey(text, "s.toml")
        diagonals = [run for run in survey.planned.runs if run.travel.is_diagonal]
        assert {run.driven_orders for run in diagonals} == {("xyz",), ("yzx",), ("zxy",)}
        run = survey.planned.run_of("linear-y")
        assert len(run_stops_mm(survey.planned, run)) > 30
        assert not [*hidden_waves(survey)], "the runs show the waves of the screws"


@given(st.tuples(*[st.integers(40, 3000)] * 3), st.sampled_from([5.0, 8.0, 10.0, 16.0, 20.0]))
def test_the_increments_offered_are_whole_micrometres_and_in_step_with_no_screw(
    size, pitch_mm
):
    offered = increments_for(size, pitch_mm)
    others = [
        n
        for n in range(8, 21)
        if all(
            round(edge_mm / n, 3) == pytest.approx(edge_mm / n, abs=1e-9) for edge_mm in size
        )
    ]
    assert others == [] or offered in others
    screws = {n: sum(in_step(edge_mm / n, pitch_mm) for edge_mm in size) for n in others}
    turns = {n: sum(in_step(edge_mm / n, 2.0 * pitch_mm) for edge_mm in size) for n in others}
    if 0 in screws.values():
        assert screws[offered] == 0
    elif others:
        assert turns[offered] == min(turns.values())


def test_a_step_of_the_usual_box_is_no_whole_number_of_turns():
    """500, 400, 300 mm and 10 mm a turn: ten increments would meet every wave in one place."""
    assert increments_for((500.0, 400.0, 300.0), 10.0) == 16
    box = parse_survey(begun(MachineClass(), "s.toml"), "s.toml").box
    assert (box.size_mm, box.increments) == ((500.0, 400.0, 300.0), 16)
