"""Every kind of line that the solver uses is planned, programmed in every dialect, recorded, shown
and ranked."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import AXES
from stepdiag.completion.foreseen import circumstances
from stepdiag.daemon.driving import sequence_of
from stepdiag.daq.capture.capture import Capture
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.service.geometry import geometry
from stepdiag.daq.service.remaining import to_drive
from stepdiag.daq.service.snapshot import setup_statuses
from stepdiag.daq.survey.file import parse_survey
from stepdiag.exporters.programs import CONTROLS, nc_programs
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.planning.planner import forecast
from stepdiag.solver.planning.search import offered
from testkit.timeline import Standstill, Timeline, survey_text

SIZE = np.array([300.0, 200.0, 100.0])
N = 2
OWN = [0.0, 40.16, 69.06, 120.47, 150.0, 178.28, 229.68, 258.59, 300.0]
"""Targets of a run of about eight along 300 mm in two increments, worked out by hand: (i - 1) p + r
with r of at most 0.3 p."""


@dataclass(frozen=True)
class Kind:
    """What the survey file says of a line, the number that the machine shows, and the axes' moves
    of each pass out."""

    plan: str
    setup: str
    code: int
    start: tuple
    passes: tuple
    along: tuple
    targets: bool = False


def steps(signs, order, n=N):
    """Return the moves of a step diagonal."""
    return [
        signs[AXES.index(axis)] * np.eye(3)[AXES.index(axis)] * SIZE / n
        for _ in range(n)
        for axis in order
    ]


def moved(setup, offset):
    return (
        f'setups = []\n[[plan.beam_offset]]\nsetup = "{setup}"\noffset_mm = {list(offset)}\n'
    )


KINDS = {
    "a single body diagonal": Kind(
        'setups = ["pnp"]\n', "pnp", 3, (0, 200, 0), (steps((1, -1, 1), "xyz"),), (1, -1, 1)
    ),
    "an order of axes for each pass": Kind(
        'setups = ["npp"]\nrepeats = 2\naxis_orders = ["yzx", "zxy"]\n',
        "npp",
        2,
        (300, 0, 0),
        (steps((-1, 1, 1), "yzx"), steps((-1, 1, 1), "zxy")),
        (-1, 1, 1),
    ),
    "an order of axes for each setup": Kind(
        'setups = ["pnp"]\naxis_orders = ["xyz", "yzx", "zxy"]\nalternate_orders = true\n',
        "pnp",
        3,
        (0, 200, 0),
        (steps((1, -1, 1), "zxy"),),
        (1, -1, 1),
    ),
    "a beam shifted by any amount": Kind(
        moved("ppp", (0.0, 37.5, 0.0)),
        "ppp+1",
        1,
        (0, 0, 0),
        (steps((1, 1, 1), "xyz"),),
        (1, 1, 1),
    ),
    "a face diagonal": Kind(
        'setups = ["face-xz-pp"]\n',
        "face-xz-pp",
        101,
        (0, 0, 0),
        (steps((1, 0, 1), "xz"),),
        (1, 0, 1),
    ),
    "a face diagonal at another level": Kind(
        moved("face-xy-np", (0.0, 0.0, 50.0)),
        "face-xy-np+1",
        101,
        (300, 0, 50),
        (steps((-1, 1, 0), "xy"),),
        (-1, 1, 0),
    ),
    "a run on a parallel line": Kind(
        moved("linear-y", (300.0, 0.0, 70.0)),
        "linear-y+1",
        101,
        (300, 0, 70),
        ([np.array([0.0, 100.0, 0.0])] * 2,),
        (0, 1, 0),
    ),
    "a run with targets of its own": Kind(
        'setups = ["linear-x"]\ntargets = 8\n',
        "linear-x",
        11,
        (0, 0, 0),
        ([np.array([step, 0.0, 0.0]) for step in np.diff(OWN)],),
        (1, 0, 0),
        targets=True,
    ),
    "a body diagonal read once per increment": Kind(
        'setups = ["body-ppn"]\n',
        "body-ppn",
        101,
        (0, 0, 100),
        ([SIZE / N * (1, 1, -1)] * 2,),
        (1, 1, -1),
    ),
}


@pytest.fixture(params=KINDS, ids=str)
def kind(request):
    return KINDS[request.param]


def test_a_run_of_the_head_is_planned_programmed_shown_and_ranked():
    """Its own record, not readings: recorded in tests/system/recording/test_fourdof_survey.py."""
    head = (
        '[head]\nformat = "fourdof"\nport = "/dev/zero"\nid = "A"\ncalibration = "a.toml"\n'
    )
    survey = parse_survey(
        survey_text(n=N, size=SIZE.tolist(), setups=("ppp", "linear-x", "fourdof-x")) + head,
        "survey.toml",
    )
    about = replace(circumstances(survey), assumed=Assumptions())
    without = replace(survey.planned, runs=survey.planned.runs[:-1])
    assert (
        forecast(survey.planned, about).ahead.full[0] < forecast(without, about).ahead.full[0]
    )
    assert "fourdof-x" in {run.setup for run in offered(survey.planned, about)}
    for control in CONTROLS:
        program = nc_programs(sequence_of(survey), control)[-1]
        assert program.setup == "fourdof-x"
        assert re.search(r"\b21\b", program.data.decode("ascii"))
    book = PassBook(survey)
    statuses = setup_statuses(survey, book, to_drive(survey, book))
    drawn = geometry(survey.planned, statuses, "fourdof-x", 1)
    assert drawn.ways[-1].ends_mm == ((0.0, 0.0, 0.0), (300.0, 0.0, 0.0))


def survey_of(kind):
    text = survey_text(n=N, size=SIZE.tolist()).replace(
        'setups = ["ppp"]\nreturn_pass = false\ndwell_s = 0.8\n', "\0"
    )
    settings, _, lines = kind.plan.partition("[[")
    return parse_survey(
        text.replace(
            "\0",
            f"{settings}return_pass = false\ndwell_s = 0.8\n"
            + ("[[" + lines if lines else ""),
        ),
        "survey.toml",
    )


def stops_of(kind, number):
    return np.cumsum([kind.start, *kind.passes[number]], axis=0)


def test_every_kind_is_planned_programmed_recorded_shown_and_ranked(kind):
    survey = survey_of(kind)
    planned_and_ranked(kind, survey)
    programmed(kind, survey)
    recorded_and_shown(kind, survey)


def planned_and_ranked(kind, survey):
    about = replace(circumstances(survey), assumed=Assumptions())
    alone = forecast(survey.planned, about)
    assert alone.minutes > 5.0
    # beside the usual lines it tells something, so that the search ranks it by what it brings
    others = replace(
        survey.planned, runs=tuple(run for run in forecastable() if run.setup != kind.setup)
    )
    with_it = replace(others, runs=(*others.runs, *survey.planned.runs))
    assert forecast(with_it, about).ahead.full[0] < forecast(others, about).ahead.full[0] * (
        1.0 - 1e-6
    )
    if kind.setup.startswith("body"):
        return
    base = kind.setup.partition("+")[0]
    assert base in {run.setup for run in offered(survey.planned, about)}


def forecastable():
    return parse_survey(
        survey_text(n=N, size=SIZE.tolist(), setups=("ppp", "linear-y")), "survey.toml"
    ).planned.runs


def programmed(kind, survey):
    for control in CONTROLS:
        (program,) = nc_programs(sequence_of(survey), control)
        text = program.data.decode("ascii")
        moves = [
            tuple(map(float, found))
            for found in re.findall(r"X([+-]?[\d.]+) Y([+-]?[\d.]+) Z([+-]?[\d.]+)", text)
        ]
        driven = [
            place for number in range(len(kind.passes)) for place in stops_of(kind, number)
        ]
        stands = [
            move
            for move in moves
            if any(np.allclose(move, place, atol=5e-4) for place in driven)
        ]
        assert np.allclose(stands, driven, atol=5e-4), control
        assert re.search(rf"\b{kind.code}\b", text), "the number that the machine shows"


def recorded_and_shown(kind, survey):
    book = PassBook(survey)
    unit = np.array(kind.along) * SIZE / np.linalg.norm(np.array(kind.along) * SIZE)
    for number in range(len(kind.passes)):
        (status,) = setup_statuses(survey, book, to_drive(survey, book))
        assert (status.name, status.passes_done, status.state) == (
            kind.setup,
            number,
            "to-do",
        )
        drawn = geometry(survey.planned, (status,), kind.setup, 2 * number + 1)
        places = stops_of(kind, number)
        assert np.allclose(drawn.route_mm, places, atol=5e-3)
        assert np.allclose(drawn.ways[0].ends_mm, places[[0, -1]])
        stands = [
            Standstill(tuple(place.tolist()), float((place - places[0]) @ unit), kind.code)
            for place in places
        ]
        capture = Capture(survey, book.start(skip_open_dwell=False))
        outcomes = [
            outcome for event in Timeline(stands).events() for outcome in capture.feed(event)
        ] + capture.finish()
        for stop in (each for each in outcomes if isinstance(each, CapturedStop)):
            book.add(stop)
    assert book.complete(), [each.why_incomplete() for each in book.passes]
    readings = tabulate(survey, book.passes)
    assert set(readings.setup) == {kind.setup}
    driven = np.vstack([stops_of(kind, number) for number in range(len(kind.passes))])
    assert np.allclose(readings.position_mm, driven, atol=5e-3)
    layout = lay_out(readings, "recorded", survey.volume)
    assert np.max(np.abs(layout.deviation_um)) < 1.0
    offset = survey.planned.runs[0].beam_offset_mm
    if any(offset):
        signs = np.array(kind.along)
        usual = np.where(signs < 0, SIZE, 0.0)
        assert np.allclose(layout.beam_mm[0], usual + offset)
