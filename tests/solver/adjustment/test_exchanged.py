"""Diagonals that were driven in each other's place: found by the readings of the whole survey, and
no good survey has such a pair."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, Bench
from testkit.examples import spread

NAMED = "step-mismatch.names"


def exchanged(readings, first, second):
    """Return the readings with those of two setups exchanged."""
    names = np.array(readings.setup)
    reading = readings.reading_mm.copy()
    reading[names == first] = readings.reading_mm[names == second]
    reading[names == second] = readings.reading_mm[names == first]
    return replace(readings, reading_mm=reading)


def slipped(readings, setup, stop, size_um):
    """Return the readings with a step of the count before a stop of a setup."""
    after = (np.array(readings.setup) == setup) & (np.array(readings.stop) >= stop)
    return replace(readings, reading_mm=readings.reading_mm + 1e-3 * size_um * after)


@pytest.mark.parametrize(
    ("first", "second", "how"),
    spread(
        [
            (*names, how)
            for names in (("npp", "pnp"), ("ppp", "ppn"))
            for how in ({}, {"passes": (1, 2)})
        ],
        3,
    ),
    ids=str,
)
def test_exchanged_diagonals_are_named_and_put_right(first, second, how):
    for seed in spread((40, 41, 42), 3):
        readings = Bench(seed=seed).survey(**how)
        right = adjust(lay_out(readings), "FXYZ")
        found = adjust(lay_out(exchanged(readings, first, second)), "FXYZ")
        named = [one for one in found.findings if one.key == NAMED]
        assert [one.severity for one in named] == ["error"]
        assert {named[0].message.arguments[name] for name in ("first", "second")} == {
            first,
            second,
        }
        functions = slice(0, 90)
        assert found.fit.unknowns[functions] == pytest.approx(
            right.fit.unknowns[functions], abs=0.1
        )


@pytest.mark.parametrize(
    ("seed", "setup", "stop", "size_um"), [(1114, "npp", 9, 100.0), (1372, "ppp", 9, 50.0)]
)
def test_a_slip_of_the_count_is_no_exchange(seed, setup, stop, size_um):
    """An exchange explains part of these slips, the step all of it."""
    readings = Bench(seed=seed).survey()
    found = adjust(lay_out(slipped(readings, setup, stop, size_um)), "FXYZ")
    assert [one.key for one in found.findings if one.severity == "error"] == []
    assert "count-step" in [one.key for one in found.findings]


@pytest.mark.parametrize("how", [{}, {"passes": (1, 2)}, {"setups": DIAGONALS}])
def test_no_good_survey_has_exchanged_diagonals(how):
    """0 of 8, and 0 of 2 in a usual run."""
    for seed in spread(range(50, 58), 4):
        found = adjust(lay_out(Bench(seed=seed).survey(**how)), "FXYZ")
        assert NAMED not in [one.key for one in found.findings]
