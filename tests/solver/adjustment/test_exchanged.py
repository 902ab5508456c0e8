"""Setups whose programs drove other diagonals: found by the readings of the whole survey, and no
good survey has such setups."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.model.layout import lay_out
from testkit.exact.surveys import DIAGONALS, Bench
from testkit.examples import spread

NAMED, OPEN = "step-mismatch.names", "step-mismatch.programs"
PAIR = {"npp": "pnp", "pnp": "npp"}
THREE = {"ppp": "npp", "npp": "pnp", "pnp": "ppp"}
FOUR = {"ppp": "npp", "npp": "pnp", "pnp": "ppn", "ppn": "ppp"}
PAIRS = {"ppp": "ppn", "ppn": "ppp", **PAIR}


def driven(readings, names, noise_um=0.3):
    """Return the readings of setups whose programs drove the diagonals ``names``. A diagonal that
    is driven twice is read twice."""
    setup, rng = np.array(readings.setup), np.random.default_rng(0)
    reading = readings.reading_mm.copy()
    for name, diagonal in names.items():
        there = readings.reading_mm[setup == diagonal]
        again = diagonal not in names
        reading[setup == name] = there + again * 1e-3 * rng.normal(0.0, noise_um, len(there))
    return replace(readings, reading_mm=reading)


def findings_of(readings):
    """Return the findings of the solver about names of setups, and what the solver found."""
    found = adjust(lay_out(readings), "FXYZ")
    return [one for one in found.findings if one.key in (NAMED, OPEN)], found


def suspects_of(finding):
    """Return the suspected names, most probable first."""
    words = finding.message.arguments
    every = [words] if finding.key == NAMED else [one.arguments for one in words["suspects"]]
    return [dict(zip(one["setups"], one["driven"], strict=True)) for one in every]


def slipped(readings, setup, stop, size_um):
    """Return the readings with a step of the count before a stop of a setup."""
    after = (np.array(readings.setup) == setup) & (np.array(readings.stop) >= stop)
    return replace(readings, reading_mm=readings.reading_mm + 1e-3 * size_um * after)


@pytest.mark.parametrize(
    ("names", "how"),
    spread(
        [
            (names, how)
            for names in (PAIR, THREE, FOUR, PAIRS)
            for how in ({}, {"passes": (1, 2)})
        ],
        4,
    ),
    ids=str,
)
def test_other_diagonals_are_named_and_put_right(names, how):
    for seed in spread((40, 42, 43), 2):
        readings = Bench(seed=seed).survey(**how)
        right = adjust(lay_out(readings), "FXYZ")
        (named,), found = findings_of(driven(readings, names))
        assert (named.key, named.severity, suspects_of(named)) == (NAMED, "error", [names])
        functions = slice(0, 90)
        assert found.fit.unknowns[functions] == pytest.approx(
            right.fit.unknowns[functions], abs=0.1
        )


@pytest.mark.parametrize(
    "names", spread([PAIR, THREE, FOUR, PAIRS, {"npp": "ppn"}], 3), ids=str
)
def test_few_readings_name_other_diagonals_or_refuse_the_result(names):
    """A survey of two increments, driven once: the true names are sure, or suspected first."""
    for seed in spread(range(40, 48), 4):
        (named,), _ = findings_of(driven(Bench(seed=seed, increments=2).survey(), names))
        assert named.severity == "error"
        assert names in suspects_of(named)


@pytest.mark.parametrize("how", spread([{}, {"passes": (1, 2)}], 2), ids=str)
def test_a_diagonal_that_is_driven_twice_is_refused(how):
    """The planned diagonal is missing, so no name puts the result right."""
    for seed in spread((40, 41, 42), 2):
        (named,), _ = findings_of(driven(Bench(seed=seed).survey(**how), {"npp": "ppn"}))
        assert (named.key, named.severity) == (OPEN, "error")
        assert {place.split("/")[0] for place in named.among} <= {"npp", "ppn"}
        assert {"npp": "ppn"} in suspects_of(named)


@pytest.mark.parametrize(
    ("seed", "setup", "stop", "size_um"), [(1114, "npp", 9, 100.0), (1372, "ppp", 9, 50.0)]
)
def test_a_slip_of_the_count_is_no_exchange(seed, setup, stop, size_um):
    """Other names explain part of these slips, the step all of it."""
    readings = Bench(seed=seed).survey()
    found = adjust(lay_out(slipped(readings, setup, stop, size_um)), "FXYZ")
    assert [one.key for one in found.findings if one.severity == "error"] == []
    assert "count-step" in [one.key for one in found.findings]


@pytest.mark.parametrize("size_um", [20.0, 60.0])
def test_a_wandering_pass_is_no_other_diagonal(size_um):
    for seed in spread((60, 61, 62), 3):
        readings, rng = Bench(seed=seed).survey(), np.random.default_rng(seed)
        wanders = np.array(readings.setup) == "ppn"
        walk_um = np.cumsum(
            wanders * rng.normal(0.0, size_um / np.sqrt(np.sum(wanders)), 157)
        )
        assert (
            findings_of(
                replace(readings, reading_mm=readings.reading_mm + 1e-3 * wanders * walk_um)
            )[0]
            == []
        )


@pytest.mark.parametrize(
    ("increments", "how"),
    [(10, {}), (10, {"passes": (1, 2)}), (10, {"setups": DIAGONALS}), (2, {})],
)
def test_no_good_survey_has_other_diagonals(increments, how):
    for seed in spread(range(50, 58), 4):
        assert findings_of(Bench(seed=seed, increments=increments).survey(**how))[0] == []
