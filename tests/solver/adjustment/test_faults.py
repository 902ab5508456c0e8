"""Wrong stops: found, named, and without effect on the result beyond its uncertainty."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import Result
from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.adjustment.counts import short_counts
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, IDEAL, LINEAR, Bench, solved
from testkit.examples import spread

FULL = (*DIAGONALS, *LINEAR)
NAMES = ("stop-outlier", "contradiction-ambiguous.stop", "contradiction-ambiguous")
PICKED = [0, 3, 9, 18, 27, 30, 32, 46, 60, 63, 77, 91, 94, 108, 122, 124, 136, 156]
"""Rows of every diagonal and of the runs at both ends: each pass has 31, each run 11."""


@cache
def clean(setups, increments=6):
    """Return good readings and their result."""
    readings = Bench(seed=2, increments=increments).survey(setups)
    return readings, solve(readings)


@cache
def clean_where_no_target_is_missed():
    """Return the good readings of the full survey and their result for an ideal machine."""
    readings = clean(FULL, 10)[0]
    return readings, solve(readings, assumed=IDEAL)


def spoiled(readings: Readings, row: int, error_um: float) -> Readings:
    reading = readings.reading_mm.copy()
    reading[row] += error_um * 1e-3
    return replace(readings, reading_mm=reading)


def name_of(readings: Readings, row: int) -> str:
    """Return the place of a stop as a message names it."""
    number = int(readings.pass_number[row])
    way = "out" if number % 2 else "back"
    return f"({readings.setup[row]}), pass {number} {way}, stop {readings.stop[row] + 1} "


def moved(before, after) -> tuple[float, float]:
    """Return the root mean square and the largest move of all values, in units of their uncertainty
    after the stop was wrong."""
    moves = []
    for name, function in before.errors.items():
        other = after.errors[name]
        told = other.u > 1e-9
        moves += ((other.value - function.value)[told] / other.u[told]).tolist()
    moves += [
        (after.squareness[name].value - q.value) / after.squareness[name].u
        for name, q in before.squareness.items()
    ]
    moves += [
        (after.scale[name].value - s.value) / after.scale[name].u
        for name, s in before.scale.items()
        if s.identified
    ]
    return float(np.sqrt(np.mean(np.square(moves)))), float(np.max(np.abs(moves)))


@pytest.mark.parametrize(
    ("error_um", "rows"),
    [(8.0, PICKED[::3]), (-8.0, PICKED[1::3]), (5000.0, PICKED[2::3])],
    ids=["8", "-8", "5000"],
)
def test_with_linear_runs_every_wrong_stop_is_found_and_harmless(error_um, rows):
    """On a machine that misses no target. Elsewhere (next test) its first stops may be beside them
    by backlash."""
    readings, before = clean_where_no_target_is_missed()
    for row in spread(rows, 2):
        after = solve(spoiled(readings, row, error_um), assumed=IDEAL)
        texts = [finding.text for finding in after.findings if finding.key in NAMES]
        assert any(name_of(readings, row) in text for text in texts), name_of(readings, row)
        if any(finding.severity == "error" for finding in after.findings):
            continue
        rms, largest = moved(before, after)
        assert rms < 0.5
        assert largest < 1.3


@pytest.mark.parametrize("error_um", spread([8.0, -8.0], 2))
def test_a_wrong_stop_of_an_ordinary_machine_is_found_or_lies_within_u(error_um):
    """At the first two stops it may be backlash of a pass that begins without overrun: there U
    holds it (1.5 u of 2). All others are named."""
    readings, before = clean(FULL, 10)
    for row in spread(PICKED[::2], 2):
        after = solve(spoiled(readings, row, error_um))
        texts = [finding.text for finding in after.findings if finding.key in NAMES]
        assert (
            any(name_of(readings, row) in text for text in texts) or readings.stop[row] < 2
        ), name_of(readings, row)
        if not any(finding.severity == "error" for finding in after.findings):
            assert moved(before, after)[0] < 1.5


def again(seed: int, driven: Sequence[str], size_um: float, *, step: bool) -> Result:
    """Return the result of a survey with npp driven twice, where the drives ``driven`` show an
    error at stop 13, or a step before it."""
    readings = Bench(seed=seed).survey((*FULL, "npp+1"))
    stop = np.array(readings.stop)
    there = np.isin(readings.setup, driven) & ((stop >= 12) if step else (stop == 12))
    return solve(replace(readings, reading_mm=readings.reading_mm + 1e-3 * size_um * there))


@pytest.mark.parametrize("step", [False, True])
@pytest.mark.parametrize("seed", spread(range(20), 7))
def test_the_same_contradiction_in_each_drive_of_a_setup_is_the_machine(seed, step):
    """Two wrong stops were named, or a step of another diagonal was subtracted: on the closure it
    has nearly the same effect, and in a few surveys both stay possible."""
    before, after = (again(seed, ("npp", "npp+1"), um, step=step) for um in (0.0, 10.0))
    (named,) = [each for each in after.findings if each.severity != "info"]
    if step and named.key == "contradiction-ambiguous":
        assert "an error of the machine at stop 13 of" in named.text
        return
    assert named.key == "machine-beside-model.place"
    assert "stop 13 of" in named.text
    assert named.size_um == pytest.approx(10.0, abs=2.0)
    assert moved(before, after)[0] < 1.0


@pytest.mark.parametrize(("step", "key"), [(False, "stop-outlier"), (True, "count-step")])
def test_a_contradiction_in_one_of_two_drives_is_no_error_of_the_machine(step, key):
    found = again(3, ("npp",), 10.0, step=step)
    assert [each.key for each in found.findings if each.severity != "info"] == [key]


def test_five_millimetres_on_four_diagonals_alone_are_found_and_harmless():
    """One pass of four diagonals checks a stop through one other stop only: smoothness tells which
    is wrong."""
    readings, before = clean(DIAGONALS)
    for row in spread(range(0, 76, 11), 2):
        after = solve(spoiled(readings, row, 5000.0))
        texts = [finding.text for finding in after.findings if finding.key == "stop-outlier"]
        assert any(name_of(readings, row) in text for text in texts), name_of(readings, row)
        rms, largest = moved(before, after)
        assert rms < 0.5
        assert largest < 2.0


@pytest.mark.parametrize(("error_um", "least"), [(4.0, 0), (20.0, 5)])
def test_a_stop_that_two_diagonals_could_have_wrong_is_named_rightly_or_as_one_of_several(
    error_um, least
):
    """One pass of four diagonals: smoothness decides, and where it does not, every candidate is
    said. 4 µm pass for noise that so few readings show, and the result moves by less than its U (2
    u)."""
    readings, before = clean(DIAGONALS)
    named = 0
    for row in range(4, 76, 12):
        after = solve(spoiled(readings, row, error_um))
        texts = [finding.text for finding in after.findings if finding.key in NAMES]
        assert not texts or any(name_of(readings, row) in text for text in texts)
        named += bool(texts)
        assert moved(before, after)[0] < 1.5
    assert named >= least


def test_a_wrong_first_stop_is_named_although_all_others_are_relative_to_it():
    readings, before = clean(FULL)
    reading = np.where(
        np.array(readings.setup) == "pnp", readings.reading_mm - 0.05, readings.reading_mm
    )
    reading[name_index(readings, "pnp", 0)] = 0.0
    after = solve(replace(readings, reading_mm=reading))
    assert any(
        "(pnp), pass 1 out, stop 1 " in finding.text
        for finding in after.findings
        if finding.key == "stop-outlier"
    )
    assert moved(before, after)[0] < 0.5


def name_index(readings: Readings, setup: str, stop: int) -> int:
    return next(
        row
        for row in range(len(readings))
        if readings.setup[row] == setup and readings.stop[row] == stop
    )


def test_good_surveys_are_left_alone():
    codes = [finding.key for seed in range(12) for finding in solved(seed).findings]
    assert sum(code.startswith("stop-outlier") for code in codes) <= 1
    assert "too-many-outliers" not in codes


def test_two_wrong_stops_are_both_found():
    readings, before = clean(FULL)
    after = solve(spoiled(spoiled(readings, 11, 8.0), 70, -2000.0))
    texts = " ".join(
        finding.text for finding in after.findings if finding.key.startswith("stop-outlier")
    )
    assert name_of(readings, 11) in texts
    assert name_of(readings, 70) in texts
    assert moved(before, after)[0] < 0.6


def test_a_setup_that_went_wrong_as_a_whole_is_not_mended_stop_by_stop():
    readings, _ = clean(FULL)
    wrong = np.array(readings.setup) == "npp"
    noise = np.random.default_rng(0).normal(scale=0.03, size=len(readings))
    after = solve(
        replace(readings, reading_mm=readings.reading_mm + np.where(wrong, noise, 0.0))
    )
    assert any(
        "npp" in finding.text for finding in after.findings if finding.severity == "error"
    )
    assert not {"stop-outlier", "count-step"} & {finding.key for finding in after.findings}
    # a machine that is known to repeat says which setup it is
    known = solve(
        replace(readings, reading_mm=readings.reading_mm + np.where(wrong, noise, 0.0)),
        assumed=IDEAL,
    )
    assert any(
        "npp" in finding.text for finding in known.findings if finding.severity == "error"
    )


def too_short(readings):
    """Return the setups with a count too short to show a step."""
    layout = lay_out(readings)
    found = short_counts(adjust(layout, "FXYZ").fit.fixed, layout, ("step", "linear"))
    return [layout.setups[layout.setup_index[rows[0]]].name for rows in found]


@pytest.mark.parametrize(("increments", "short"), [(1, True), (2, True), (3, False)])
def test_a_run_of_two_or_three_readings_is_too_short_to_show_a_slip(increments, short):
    assert (
        "linear-x" in too_short(Bench(increments=increments).survey((*DIAGONALS, "linear-x")))
    ) == short


def test_a_count_of_one_reading_has_no_step_that_could_slip():
    """The count was lost before the last stop of a run of five: four are enough to show a slip, and
    one alone has none."""
    readings = Bench(increments=4).survey((*DIAGONALS, "linear-x"))
    mine = np.array(readings.setup) == "linear-x"
    zero = np.where(mine, 1 + (readings.stop == 4), readings.zero)
    last = mine & (readings.stop == 4)
    cut = replace(readings, zero=zero, reading_mm=np.where(last, 0.0, readings.reading_mm))
    assert too_short(cut) == []


@pytest.mark.parametrize("step", [True, False], ids=["step", "stop"])
def test_a_fault_of_one_pass_that_is_repaired_is_no_scatter_of_the_repeats(step):
    """50 µm in one of two passes: the survey was refused, as one that repeats to 17 µm."""
    readings = Bench(seed=2, increments=6).survey((*DIAGONALS, *LINEAR), passes=(1, 3))
    stop = np.array(readings.stop)
    wrong = (
        (np.array(readings.setup) == "ppn")
        & (np.array(readings.pass_number) == 1)
        & (stop >= 9 if step else stop == 9)
    )
    after = solve(replace(readings, reading_mm=readings.reading_mm + 0.05 * wrong))
    serious = [each.key for each in after.findings if each.severity != "info"]
    assert serious == ["count-step" if step else "stop-outlier"]
    repeats_um = solve(readings).setups["ppn"].repeatability_um
    assert after.setups["ppn"].repeatability_um == pytest.approx(repeats_um, rel=0.1)
