"""What the readings know of the machine beside what only the usual says of it."""

from dataclasses import replace

import numpy as np
import pytest

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.solver.methods.estimate import estimate
from stepdiag.solver.model.layout import lay_out
from stepdiag.solver.uncertainty.machine import (
    covariance,
    machine_of,
    separated,
    usual_rows,
    with_usual,
)
from testkit.exact.surveys import DIAGONALS, IDEAL, LINEAR, Bench


@pytest.mark.parametrize(
    "setups",
    [DIAGONALS, LINEAR, DIAGONALS[:1], (*DIAGONALS, LINEAR[0])],
    ids=["diagonals", "linear", "one", "more"],
)
@pytest.mark.parametrize(("factor", "more"), [(1.0, 0.1), (10.0, 0.005)])
def test_what_is_known_and_what_is_not_make_the_covariance_with_what_is_usual(
    setups, factor, more
):
    """Of a fit in which rows of what is usual stand beside the readings comes the same, the closer
    the larger the usual is.

    Where it is hardly larger than what is known, it says a little of that too: never is less said
    to be uncertain for it.
    """
    done = estimate(
        lay_out(
            Bench(
                angle_urad=2.0, increments=2, diagonal_noise_um=0.1, linear_noise_um=0.1
            ).survey(setups)
        ),
        "FXYZ",
        assumed=IDEAL,
    )
    found, spread = done.adjustment, done.spread
    rows, u = usual_rows(done.quantities, done.known, found.assumed)
    machine = machine_of(found.design, found.shapes, 0, len(spread.fit.size))
    told, unmeasured = separated(machine, spread.fit.inverse, rows, u)
    both = covariance(spread, told) + factor**2 * unmeasured
    beside = covariance(
        replace(spread, fit=with_usual(found.fit, found.design, rows, factor * u)), machine
    )
    ratio = np.sqrt(np.diag(both) / np.diag(beside))
    assert np.all(ratio > 1.0 - 1e-3)
    assert np.all(ratio < 1.0 + more)


@pytest.mark.parametrize("name", ["shape_um", "squareness_urad", "scale_um_m"])
def test_a_usual_size_of_next_to_nothing_leaves_the_others_what_they_are(name):
    """Who states 1e-9 says that there is none of it, and nothing of what else was not measured:
    that is as unknown as with 1e-3."""

    def unmeasured_um2(size):
        done = estimate(lay_out(Bench(increments=2).survey(LINEAR)), "FXYZ")
        rows, u = usual_rows(done.quantities, done.known, Assumptions(**{name: size}))
        machine = machine_of(
            done.adjustment.design, done.adjustment.shapes, 0, len(done.spread.fit.size)
        )
        return np.trace(separated(machine, done.spread.fit.inverse, rows, u)[1])

    assert unmeasured_um2(1e-9) == pytest.approx(unmeasured_um2(1e-3), rel=1e-3)
    assert unmeasured_um2(1e-9) > 100.0
