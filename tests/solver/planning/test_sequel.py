"""What to drive next in a survey that is under way, on exact machines that share no code with the
product."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import anywhere_mm, rms
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.planning.search import Exchange, every_way, offered
from stepdiag.solver.planning.sequel import LEAST_UM, sequel
from testkit.rates import designs

SEVEN = replace(
    designs.EMPTY, runs=tuple(Run(setup=name) for name in (*BODY_DIAGONALS, *LINEAR_RUNS))
)
NAMES = [run.setup for run in SEVEN.runs]
JOB = designs.about(15.0)


def left_um(survey, machine):
    points = anywhere_mm(designs.VOLUME)
    result = solve(
        designs.drive(survey, machine, np.random.default_rng(4)),
        chain=JOB.chain,
        assumed=JOB.assumed,
    )
    error = machine.error_at(points) - error_field_um(result, points)
    return rms(np.linalg.norm(without_rigid_motion(designs.VOLUME, points, error), axis=1))


@pytest.fixture(scope="module")
def wide():
    """Seven setups on a machine whose angles are three times those assumed."""
    machine = designs.machine_of(40.0, 911)
    return machine, sequel(
        SEVEN, JOB, NAMES, designs.drive(SEVEN, machine, np.random.default_rng(4))
    )


def test_the_setups_show_the_angles_and_the_further_one_that_buys_most(wide):
    machine, ahead = wide
    assert 28.0 < ahead.angles_urad < 57.0
    assert not ahead.end
    assert ahead.runs[0].setup not in NAMES
    now, then = (
        left_um(SEVEN, machine),
        left_um(replace(SEVEN, runs=(*SEVEN.runs, *ahead.runs)), machine),
    )
    assert now - then > LEAST_UM
    assert now - then < ahead.at_most_um


def test_small_angles_end_the_survey():
    quiet = sequel(
        SEVEN,
        JOB,
        NAMES,
        designs.drive(SEVEN, designs.machine_of(3.0, 911), np.random.default_rng(4)),
    )
    assert quiet.end
    assert quiet.now_um - quiet.then_um < LEAST_UM
    assert quiet.angles_urad is None or quiet.angles_urad < 8.0


def test_a_survey_without_a_further_line_ends():
    every = designs.EMPTY.with_runs(*offered(SEVEN, JOB))
    ahead = sequel(every, JOB, [run.setup for run in every.runs])
    assert (ahead.end, ahead.runs) == (True, ())


def test_one_diagonal_shows_no_angles_and_the_plan_goes_on():
    alone = replace(SEVEN, runs=SEVEN.runs[:1])
    ahead = sequel(
        SEVEN,
        JOB,
        NAMES[:1],
        designs.drive(alone, designs.machine_of(40.0, 911), np.random.default_rng(4)),
    )
    assert ahead.angles_urad is None
    assert not ahead.end
    assert ahead.runs[0].setup in NAMES or ahead.runs[0].travel.base == "ppp", (
        "planned, or beside what stands"
    )


def test_what_stands_comes_first_and_is_shifted_in_five_minutes():
    """Of lines beside the last setup the first costs the shift, of others an alignment."""
    lines = offered(SEVEN, JOB)
    exchange = Exchange(SEVEN, JOB, lines, every_way(2.0, JOB)[1], SEVEN.runs[:4])
    beside = {
        base: next(
            place
            for place, line in enumerate(lines)
            if line.setup == base and any(line.beam_offset_mm)
        )
        for base in NAMES[:4]
    }
    minutes = {base: exchange.minutes([place], 10) for base, place in beside.items()}
    assert minutes["ppn"] == pytest.approx(minutes["ppp"] - 25.0, abs=0.5)


@pytest.mark.parametrize("count", [1, 3, 5])
def test_what_is_driven_counts_as_what_is_chosen(count):
    lines, ways = offered(SEVEN, JOB), every_way(2.0, JOB)[1]
    first, last = list(range(count)), count + 3
    chosen = Exchange(SEVEN, JOB, lines, ways).square_um2([*first, last])
    given = Exchange(
        SEVEN, JOB, [lines[last]], ways, [ways.of(lines[place]) for place in first]
    )
    assert given.square_um2([0]) == pytest.approx(chosen, rel=1e-6)
    mean, spread = given.lowered_um2([0])
    assert mean == pytest.approx(given.square_um2([]) - chosen, rel=1e-6)
    assert spread > 0
