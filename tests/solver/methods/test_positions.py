"""Stops beside their targets: rounded programs, scattering encoders, flickering registers. The
answer is that of the exact positions."""

import json
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.base.readings.readings import render_readings
from stepdiag.base.result.result import Result
from stepdiag.solver.methods.solve import solve
from testkit.cli import stepdiag
from testkit.exact.beside import Beside, as_exact, as_written, rounded, scattered
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import few, spread

STEEPEST_UM = 150.0
"""Over the length of the axis in mm: the slope of the drawn functions in um/mm. A node's value
cannot change by more than the slope times the way beside the node."""
LEAST_UM = 0.03
"""Without noise, sizes of causes are found from nearly nothing, among them what share of their
scatter the registers make alone."""
FINE = {
    "linear-x": (
        0.0,
        17.31,
        33.333,
        51.2,
        77.0,
        98.765,
        130.1,
        165.5,
        201.25,
        250.0,
        300.4,
        344.4,
        390.0,
        444.4,
        480.8,
        500.0,
    ),
    "linear-y": (
        0.0,
        33.3,
        71.0,
        100.0,
        128.4,
        160.0,
        210.7,
        240.0,
        297.3,
        320.0,
        355.5,
        400.0,
    ),
    "linear-z": (
        0.0,
        10.0,
        20.0,
        47.0,
        90.0,
        133.0,
        155.5,
        190.0,
        210.0,
        250.0,
        280.0,
        300.0,
    ),
}
"""Targets of linear runs by ISO 230-2: their own, and at no regular distance."""
CHAINS = ("FXYZ", "XFYZ", "XYFZ", "XYZF")
SOLVED: dict[str, Result] = {}


def numbers(result: Result):
    """Return every number of a result by its name, None where it is not identified."""
    found = {name: function.value for name, function in result.errors.items()}
    found |= {
        f"reversal {name}": function.value for name, function in result.reversal.items()
    }
    found |= {name: quantity.value for name, quantity in result.squareness.items()}
    return found | {name: scale.value for name, scale in result.scale.items()}


def warnings(result: Result):
    return sorted(finding.key for finding in result.findings if finding.severity != "info")


def at_targets(survey: Beside, **options):
    """Return the result of the same machine at its targets, solved once for all tests of this
    process."""
    exact = as_exact(survey)
    asked = repr((exact, options))
    if asked not in SOLVED:
        SOLVED[asked] = solve(exact.readings(), **options)
    return SOLVED[asked]


def same_answer(survey: Beside, within_um: float, **options):
    """Compare with the survey of the same machine at its targets: values, what is null, and the
    findings that ask for something."""
    same_result(at_targets(survey, **options), solve(survey.readings(), **options), within_um)


def same_result(exact: Result, beside: Result, within_um: float):
    length_m = 1e-3 * min(exact.volume.size_mm)
    limit_um = LEAST_UM + 2.0 * within_um * STEEPEST_UM * 1e-6 / length_m
    assert beside.volume.increments == exact.volume.increments
    assert beside.volume.size_mm == pytest.approx(exact.volume.size_mm, abs=0.1)
    there = numbers(beside)
    for name, value in numbers(exact).items():
        assert (value is None) == (there[name] is None), name
        if value is not None:
            per_metre = 1.0 if name.removeprefix("reversal ")[0] == "E" else 1.0 / length_m
            assert np.max(np.abs(np.subtract(value, there[name]))) <= limit_um * per_metre, (
                name
            )
    assert warnings(beside) == warnings(exact)


@pytest.mark.parametrize(
    "setups", [DIAGONALS, (*DIAGONALS, *LINEAR)], ids=["diagonals", "diagonals and runs"]
)
@given(
    n=st.sampled_from([2, 3, 5, 8, 12, 20]),
    size_um=st.floats(0.1, 100.0),
    seed=st.integers(0, 99),
)
@few(2)
def test_a_machine_that_stands_beside_its_targets_and_says_so(setups, n, size_um, seed):
    bench = Bench(seed=seed, increments=n, tilt_mrad=1.0)
    same_answer(Beside(bench=bench, setups=setups, stands=scattered(size_um, seed)), size_um)


@given(
    n=st.sampled_from([2, 3, 6, 7, 13, 20]),
    decimals=st.lists(st.integers(1, 4), min_size=5, max_size=5),
    incremental=st.booleans(),
    uneven=st.booleans(),
    seed=st.integers(0, 99),
)
@few(2)
def test_any_mixture_of_decimals(n, decimals, incremental, uneven, seed):
    """Setups and passes have programs of their own; what G91 adds up stays within the tolerance of
    0.1 mm each way."""

    def places(setup, number):
        chosen = decimals[(sum(setup.encode()) + number) % 5]
        return max(chosen, 1 if n < 3 else 2 if n < 20 else 3) if incremental else chosen

    size = (487.31, 401.7, 303.25) if uneven else (500.0, 400.0, 300.0)
    program = rounded(places, incremental=incremental)
    same_answer(
        Beside(bench=Bench(seed=seed, increments=n, size_mm=size), stands=program), 200.0
    )


def test_a_fine_program_of_two_decimals_in_g91():
    """Forty increments add up 5 µm each: the ends lie 0.2 mm beside the box, which is what
    recording takes too."""
    survey = Beside(
        bench=Bench(seed=3, increments=37),
        setups=DIAGONALS,
        passes=(1,),
        stands=rounded(lambda *_: 2, incremental=True),
    )
    same_answer(survey, 200.0)


@pytest.mark.parametrize("n", spread([3, 6, 7], 2))
def test_a_program_of_two_decimals(n):
    same_answer(
        Beside(bench=Bench(seed=n, increments=n), stands=rounded(lambda setup, number: 2)),
        5.0,
    )


@pytest.mark.parametrize("size_um", spread([0.1, 0.5, 1.0, 3.0], 2))
def test_encoders_that_scatter(size_um):
    same_answer(
        Beside(bench=Bench(seed=1, increments=4), passes=(1,), stands=scattered(size_um, 7)),
        size_um,
    )


@pytest.mark.parametrize("off_um", spread([0.5, 3.0, 9.5, 12.0, 60.0], 2))
def test_one_position_beside_its_node(off_um):
    def one(setup, number, targets_mm):
        moved = targets_mm.copy()
        if setup == "npp" and number == 1:
            moved[7, 1] += 1e-3 * off_um
        return moved

    same_answer(Beside(bench=Bench(seed=3, increments=3), stands=one), off_um)


@pytest.mark.parametrize("chain", spread(CHAINS, 2))
def test_on_every_chain(chain):
    same_answer(
        Beside(
            bench=Bench(seed=2, increments=4, chain=chain, tilt_mrad=1.0),
            stands=scattered(3.0, 5),
        ),
        3.0,
        chain=chain,
    )


WAYS = (
    {"turned": True},
    {"joined": False},
    {"passes": (1,)},
    {"passes": (1, 2, 3, 4)},
    {"axis_order": "zxy"},
    {"targets_mm": FINE},
)


@pytest.mark.parametrize(
    ("how", "size_um"),
    spread(
        [
            (how, size_um)
            for first, how in zip(cycle((3.0, 90.0)), WAYS, strict=False)
            for size_um in (first, 93.0 - first)
        ],
        2,
    ),
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_however_the_survey_was_driven(how, size_um):
    same_answer(
        Beside(
            bench=Bench(seed=3, increments=5, tilt_mrad=1.0),
            stands=scattered(size_um, 6),
            **how,
        ),
        size_um,
    )


def test_runs_of_their_own_targets_with_one_decimal():
    survey = Beside(
        bench=Bench(seed=3, increments=3),
        stands=rounded(lambda setup, number: 1),
        targets_mm=FINE,
    )
    same_answer(survey, 50.0)


def test_with_shifted_beams_the_angles_are_the_same():
    """Their scatter is divided by the shift of the beam: 3 µm at 50 mm are 60 urad, of which the
    correction leaves next to nothing."""
    offsets = {
        "ppp+1": (0.0, 60.0, 0.0),
        "npp+1": (0.0, 0.0, 50.0),
        "pnp+1": (70.0, 0.0, 0.0),
        "ppn+1": (0.0, 40.0, 0.0),
    }
    bench = Bench(seed=3, increments=3, tilt_mrad=1.0, angle_urad=8.0, beam_offset_mm=offsets)
    survey = Beside(
        bench=bench, setups=(*DIAGONALS, *LINEAR, *offsets), stands=scattered(3.0, 5)
    )
    exact, beside = at_targets(survey), solve(survey.readings())
    assert numbers(exact).keys() == numbers(beside).keys()
    for name, function in exact.errors.items():
        # the sizes of angles are found anew, so that values may move within their uncertainty
        assert np.max(np.abs(function.value - beside.errors[name].value)) <= max(
            0.6, 2.0 * float(np.max(function.u))
        ), name
    assert warnings(exact) == warnings(beside)


@pytest.mark.parametrize(
    ("setups", "stands", "size_um"),
    spread(
        [
            pytest.param(setups, stands, size_um, id=f"{setups_id}-{stands_id}")
            for setups_id, setups in (
                ("diagonals", DIAGONALS),
                ("diagonals and runs", (*DIAGONALS, *LINEAR)),
            )
            for stands_id, stands, size_um in (
                ("3 µm", scattered(3.0, 5), 3.0),
                ("90 µm", scattered(90.0, 7), 90.0),
                ("2 decimals", rounded(lambda setup, number: 2), 5.0),
            )
        ],
        5,
    ),
)
def test_with_a_head_on_every_axis(setups, stands, size_um):
    """The head's line of alignment and the machine's slopes are one direction that no reading sees:
    one rounding keeps it so."""
    survey = Beside(
        bench=Bench(seed=3, increments=3, tilt_mrad=1.0), stands=stands, setups=setups
    )
    exact = at_targets(survey, straightness=as_exact(survey).head())
    same_result(exact, solve(survey.readings(), straightness=survey.head()), size_um)


def test_with_known_angles():
    survey = Beside(
        bench=Bench(seed=3, increments=3, angle_urad=8.0), stands=scattered(3.0, 5)
    )
    same_answer(survey, 30.0, angles=survey.bench.angles(0.0, stated=False))


@pytest.mark.parametrize("size_um", spread([0.5, 3.0], 2))
def test_registers_that_scatter_alone_are_noise(size_um):
    """The machine stands at its targets and its registers do not show it: readings and positions
    contradict each other by the scatter."""
    survey = Beside(bench=Bench(seed=3, increments=3), shows=scattered(size_um, 3))
    exact, beside = at_targets(survey), solve(survey.readings())
    for name, function in exact.errors.items():
        assert np.max(np.abs(function.value - beside.errors[name].value)) <= max(
            size_um, 4.0 * np.max(beside.errors[name].u)
        ), name
    assert warnings(exact) == warnings(beside)


@pytest.mark.parametrize("length_mm", [500.0001, 500.002])
def test_a_box_that_flickers_is_the_box_of_the_survey_file(length_mm, tmp_path):
    """One digit of a register, or what a G91 program added up: tables with a step of 50 mm fit the
    box."""
    survey = Beside(
        bench=Bench(seed=3, increments=5, size_mm=(length_mm, 400.0, 300.0)),
        passes=(1,),
        u_um=0.3,
    )
    (tmp_path / "readings.csv").write_text(
        render_readings(survey.readings()), encoding="utf-8"
    )
    done = stepdiag("solve", tmp_path / "readings.csv", "--out", tmp_path / "result.json")
    assert done.code == 0, done.refusal
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["volume"][
        "size_mm"
    ] == [500.0, 400.0, 300.0]
    out = tmp_path / "files"
    done = stepdiag(
        "export",
        tmp_path / "result.json",
        "--controller",
        "siemens",
        "--step-mm",
        "50",
        "--out",
        out,
    )
    assert done.code == 0, done.refusal
    assert list(out.glob("*.INI"))


def test_rounding_that_adds_up_beyond_the_tolerance_is_refused_with_its_cause():
    """One decimal in G91 over 19 increments: the ends lie 1 mm beside the box, and no target is
    where another pass has it."""
    bench = Bench(seed=3, increments=19)
    with pytest.raises(
        DataError,
        match=r"of 19 equal steps .* A G91 program with rounded steps misses the corner",
    ):
        solve(
            Beside(
                bench=bench, stands=rounded(lambda setup, number: 1, incremental=True)
            ).readings()
        )


def test_a_missing_stop_is_still_seen_in_a_box_of_one_millimetre():
    """The tolerance is a part of the increment there, and no step is lost in it."""
    bench = Bench(seed=1, increments=4, size_mm=(1.2, 1.0, 0.8), errors_times=0.01)
    survey = Beside(bench=bench, passes=(1,), setups=DIAGONALS)
    same_answer(replace(survey, stands=scattered(20.0, 3)), 20.0)
    whole = survey.readings()
    rows = [
        row
        for row in range(len(whole))
        if not (whole.setup[row] == "npp" and whole.stop[row] in (4, 5, 6))
    ]
    left = whole.select(rows)
    later = (np.array(left.setup) == "npp") & (left.stop > 6)
    with pytest.raises(DataError, match=r"\(npp\), pass 1 out"):
        solve(replace(left, stop=left.stop - 3 * later))


def test_as_written_is_exact():
    survey = Beside(bench=Bench(seed=1, increments=3))
    assert np.array_equal(
        survey.readings().position_mm,
        replace(survey, shows=as_written).readings().position_mm,
    )


def test_a_direction_that_is_barely_seen_is_not_identified():
    """A laser that scatters by 60 µm on the run along X tells the scale worse than what is usual
    (28 µm/m): no number."""
    survey = Beside(
        bench=Bench(seed=3, increments=5),
        setups=(*DIAGONALS, "linear-x"),
        passes=(1,),
        u_um=0.3,
    )
    readings = survey.readings()
    noise = np.where(np.array(readings.setup) == "linear-x", 60.0, 0.0)
    drawn = 1e-3 * noise * np.random.default_rng(1).standard_normal(len(noise))
    noisy = replace(
        readings,
        reading_mm=readings.reading_mm + drawn,
        u_um=np.maximum(readings.u_um, noise),
    )
    quiet, result = solve(readings), solve(noisy)
    assert quiet.scale["X"].identified
    assert not result.scale["X"].identified
    assert result.scale["X"].value is None
    assert not result.errors["EXX"].slope_identified
    text = next(
        finding.text for finding in result.findings if finding.key == "unidentified.scale"
    )
    assert "the scale of X, Y, Z" in text
    assert "about 0 min" not in text
    assert result.volumetric_u_um < 50.0
