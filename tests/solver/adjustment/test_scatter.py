"""How the machine repeats and how noisy its readings are: found from drawn surveys of known
scatter, before anything is a contradiction.

Readings are drawn from their definition (`solver.adjustment.scatter`): a miss for each move of each
axis, seen by all stops until that axis moves again, and a noise for each stop.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.readings.readings import make_readings
from stepdiag.solver.adjustment import adjustment, scatter
from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.adjustment.diagnostics import scatter_findings
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, LINEAR, Bench
from testkit.examples import spread

FULL = (*DIAGONALS, *LINEAR)
COLUMNS = ("pass_number", "stop", "position_mm", "reading_mm", "u_um", "beam_mm", "time_s")
QUIET = {"diagonal_noise_um": 0.0, "linear_noise_um": 0.0}
WAYS = {"once": (1,), "out and back": (1, 2), "three times": (1, 3, 5)}


def drawn(readings, seed, *, misses_um, noise_um, stated_um=None):
    """Return the readings of a machine that misses each target, and of a laser with noise, which it
    states where it is not said to lie.

    ``noise_um`` is a number or one for each reading. What an axis misses stays until it moves
    again, over the passes of a setup too.
    """
    rng = np.random.default_rng(seed)
    reading = readings.reading_mm.copy()
    for key, rows in readings.passes().items():
        position = readings.position_mm[rows]
        along = position[-1] - position[0] if key.outward else position[0] - position[-1]
        miss = rng.normal(scale=misses_um, size=3)
        for row, moved in zip(
            rows, np.diff(position, axis=0, prepend=position[:1]), strict=True
        ):
            miss = np.where(moved != 0, rng.normal(scale=misses_um, size=3), miss)
            reading[row] += 1e-3 * miss @ along / np.linalg.norm(along)
    noise = np.broadcast_to(noise_um, len(readings))
    stated = np.maximum(
        noise if stated_um is None else np.full(len(readings), stated_um), 0.01
    )
    return replace(
        readings,
        reading_mm=reading + 1e-3 * rng.normal(size=len(readings)) * noise,
        u_um=stated,
    )


def three_orders(seed):
    """Return one survey in which each setup is driven once in each of three orders of the axes."""
    bench = Bench(seed=seed, increments=6, **QUIET)
    parts = [
        bench.survey(DIAGONALS, passes=(number,), axis_order=order)
        for number, order in ((1, "xyz"), (3, "yzx"), (5, "zxy"))
    ]
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
    return make_readings(setup=[name for part in parts for name in part.setup], **joined)


def found_in(readings, **assumed):
    return adjust(lay_out(readings), "FXYZ", assumed=Assumptions(**assumed))


@pytest.mark.parametrize(
    ("way", "misses_um"), spread([*product([*WAYS, "three orders"], [0.1, 0.5, 1.5])], 5)
)
def test_the_repeatability_is_found_in_every_kind_of_survey(way, misses_um):
    """0.5 µm assumed. The mean over four surveys within a quarter, each within a factor of 1.7:
    some 25 to 100 moves are checked in each.

    0.1 µm are half the noise: there a survey tells little more than that it is no larger than 0.25
    um.
    """
    sizes = []
    for seed in range(4):
        clean = (
            three_orders(seed)
            if way == "three orders"
            else Bench(seed=seed, increments=8, **QUIET).survey(FULL, passes=WAYS[way])
        )
        sizes.append(
            found_in(
                drawn(clean, seed, misses_um=misses_um, noise_um=0.2)
            ).scatter.repeatability_um
        )
    if misses_um < 0.2:
        assert max(sizes) < 0.25
        return
    assert np.exp(np.mean(np.log(sizes))) == pytest.approx(misses_um, rel=0.25)
    assert np.all(np.abs(np.log(np.array(sizes) / misses_um)) < np.log(1.7))


@pytest.mark.parametrize("way", ["out and back", "three times"])
def test_noise_beside_what_is_stated_is_told_from_misses(way):
    """0.1 µm are stated and 0.6 µm are there, beside misses of 0.3 µm: found within a factor of
    2.2, as 0.05 µm are assumed beside what is stated and 0.5 µm of misses, which look much alike;
    and named."""
    for seed in spread(range(3), 2):
        clean = Bench(seed=seed, increments=8, **QUIET).survey(FULL, passes=WAYS[way])
        found = found_in(drawn(clean, seed, misses_um=0.3, noise_um=0.6, stated_um=0.1))
        assert 0.6 / 2.2 < np.mean(found.scatter.noise_um) < 0.75
        assert found.scatter.repeatability_um < 0.7
        assert "stated-u-low" in {each.code for each in scatter_findings(found)}


def test_the_noise_of_one_setup_is_told_from_that_of_the_others():
    """Vibration of 2 µm at one mirror stand, 0.1 µm at the others: it is found there and named."""
    for seed in spread(range(3), 2):
        clean = Bench(seed=seed, increments=8, **QUIET).survey(FULL, passes=(1, 2))
        shaking = np.array(clean.setup) == "pnp"
        found = found_in(
            drawn(
                clean,
                seed,
                misses_um=0.2,
                noise_um=np.where(shaking, 2.0, 0.1),
                stated_um=0.1,
            )
        )
        noise = dict(
            zip(
                (setup.name for setup in found.layout.setups),
                found.scatter.noise_um,
                strict=True,
            )
        )
        assert noise.pop("pnp") == pytest.approx(2.0, rel=0.35)
        assert max(noise.values()) < 0.4
        (low,) = [each for each in scatter_findings(found) if each.code == "stated-u-low"]
        assert low.severity == "warning"
        assert "pnp" in low.text.partition(":")[0].split(", ")
        assert "ppp" not in low.text.partition(":")[0].split(", ")


@pytest.mark.parametrize(("noise_um", "named"), [(0.8, False), (2.0, True)])
def test_a_run_whose_scatter_an_ordinary_machine_explains_states_no_u_too_low(
    noise_um, named
):
    """Each reading of a run has a move of its own: 0.8 µm are vibration, or an axis that comes back
    as ordinary ones do. The stated u of a run was blamed beside a slip that was repaired."""
    for seed in spread(range(2), 2):
        clean = Bench(seed=seed, increments=8, **QUIET).survey(FULL, passes=(1, 2))
        shaking = np.array(clean.setup) == "linear-y"
        noise = np.where(shaking, noise_um, 0.2)
        found = found_in(drawn(clean, seed, misses_um=0.2, noise_um=noise, stated_um=0.2))
        low = [each.text for each in scatter_findings(found) if each.code == "stated-u-low"]
        assert [text.partition(":")[0] for text in low] == ["linear-y"] * named


def test_an_uncertainty_that_is_stated_too_small_is_named_and_one_that_holds_is_not():
    clean = Bench(seed=1, increments=8, **QUIET).survey(FULL, passes=(1, 2))
    for stated_um, named in ((0.1, True), (0.5, False)):
        found = found_in(drawn(clean, 1, misses_um=0.3, noise_um=0.5, stated_um=stated_um))
        assert ("stated-u-low" in {each.code for each in scatter_findings(found)}) == named


def test_a_slip_of_20_um_does_not_make_the_machine_repeat_worse():
    """The robust estimate leaves the slip to be found; without it the sizes are those of the survey
    without the slip."""
    for seed in spread(range(3), 2):
        clean = drawn(
            Bench(seed=seed, increments=8, **QUIET).survey(FULL, passes=(1, 2)),
            seed,
            misses_um=0.5,
            noise_um=0.2,
        )
        late = (
            (np.array(clean.setup) == "npp")
            & (np.array(clean.pass_number) == 1)
            & (np.array(clean.stop) >= 11)
        )
        found = found_in(replace(clean, reading_mm=clean.reading_mm + 0.02 * late))
        assert {each.code for each in found.findings} == {"count-step"}
        assert found.scatter.repeatability_um == pytest.approx(
            found_in(clean).scatter.repeatability_um, rel=0.2
        )


@pytest.mark.parametrize("assumed_um", [0.2, 0.5, 1.5])
def test_where_the_readings_show_nothing_the_assumed_size_stays(assumed_um):
    """One increment, one way: no reading checks another, and no finding speaks of it."""
    clean = Bench(seed=1, increments=1, **QUIET).survey(DIAGONALS)
    found = found_in(
        drawn(clean, 1, misses_um=0.5, noise_um=0.1), repeatability_um=assumed_um
    )
    assert found.scatter.repeatability_um == pytest.approx(assumed_um, rel=0.05)
    assert "repeatability-found" not in {each.code for each in scatter_findings(found)}


def test_what_was_found_is_said_beside_what_was_assumed():
    clean = Bench(seed=2, increments=8, **QUIET).survey(FULL, passes=(1, 2))
    found = found_in(drawn(clean, 2, misses_um=1.5, noise_um=0.2))
    (said,) = [each for each in scatter_findings(found) if each.code == "repeatability-found"]
    assert said.severity == "info"
    assert f"is {found.scatter.repeatability_um:.2g} µm" in said.text
    assert "assumed 0.5" in said.text


@pytest.mark.parametrize("share", [1.0, 0.2])
@pytest.mark.parametrize("grown", [0.1, 0.5, 1.0])
def test_a_round_ends_where_readings_and_prior_balance(share, grown):
    """Sizes that are too large: the gradient of the likelihood and the prior is zero there."""
    setups, freedom = 3, 20.0
    usual = np.log(np.array([0.5, 0.5, 0.5, 1.0, *[0.1] * setups]))
    of_size = np.array([1.0] * 4 + [share] * setups)
    squares = np.full(len(usual), grown * freedom)
    found = scatter._most_likely(usual, usual, of_size, np.full(len(usual), freedom), squares)
    ratio = 1.0 - of_size + of_size * np.exp(2.0 * (found - usual))
    now = of_size * np.exp(2.0 * (found - usual)) / ratio
    pull = scatter._prior_information(setups) @ (found - usual)
    assert now * (squares / ratio - freedom) == pytest.approx(pull, abs=1e-4)
    assert np.all(found <= usual + 1e-9)


def test_a_size_that_no_reading_shows_does_not_leap_to_the_assumed_size():
    """A thousandth of a degree of freedom: the prior alone would raise the size by e^6 at once."""
    usual = np.log(np.array([0.5, 0.5, 0.5, 1.0, 0.1]))
    before = usual - 6.0
    freedom = np.full(len(usual), 1e-3)
    found = scatter._most_likely(before, usual, np.ones(len(usual)), freedom, freedom)
    assert np.all(found > before)
    assert np.all(found < usual - 1.0)


@given(st.integers(0, 2**32 - 1), st.floats(10.0, 1e6))
def test_single_wrong_stops_hardly_change_the_robust_mean(seed, wrong):
    square = np.random.default_rng(seed).normal(size=200) ** 2
    spoilt = np.where(np.arange(200) < 10, wrong, square)
    assert scatter._robust_mean(spoilt) < 1.35 * scatter._robust_mean(square)


def test_the_rounds_of_ordinary_machines_end_before_the_last():
    """Each fourth survey ended after the last round, wherever it was."""
    rounds = []

    def counted(*arguments, **options):
        rounds[-1] += options["robust"]
        return scatter.estimated(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adjustment, "estimated", counted)
        for seed in range(6):
            rounds.append(0)
            clean = Bench(seed=seed, increments=6, **QUIET).survey(FULL, passes=(1, 2))
            found_in(drawn(clean, seed, misses_um=0.3, noise_um=0.1))
    assert max(rounds) < scatter.ROUNDS
