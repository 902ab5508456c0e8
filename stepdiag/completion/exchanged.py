"""Two diagonals whose programs were exchanged, on a machine that does not show its position.

The laser's steps fit either diagonal. The whole survey separates them: only with the right names do
the readings of all setups agree on one machine. Compared are the likelihoods of the readings as
named and with each two diagonals exchanged; the priors of the machine are the same, so is the
number of unknowns.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Place, message
from stepdiag.base.names import AXES, BODY_DIAGONALS
from stepdiag.base.readings.readings import Readings
from stepdiag.daq.capture.cause.likelihood import CAUSE, SURE
from stepdiag.daq.survey.models import Survey
from stepdiag.solver.adjustment.adjustment import adjust
from stepdiag.solver.methods.lengths import at_their_temperature
from stepdiag.solver.model.layout import lay_out


def exchanged(survey: Survey, readings: Readings, assumed: Assumptions) -> list[Finding]:
    """Return the error that names two diagonals with exchanged programs; nothing if the machine
    shows its position, or the readings agree as named. The error stands at the first pass of the
    first of them, the place for its acceptance.
    """
    driven = [name for name in survey.plan.all_setups if name in BODY_DIAGONALS]
    placed = not survey.plc.silent and all(f"{axis}_mm" in survey.plc.signals for axis in AXES)
    if placed or len(driven) < 2:
        return []
    pairs = list(combinations(driven, 2))
    named = [readings, *(_renamed(readings, *pair) for pair in pairs)]
    weights, squares = np.array([_fitted(survey, each, assumed) for each in named]).T
    # few readings agree by chance with less noise than any machine has: no name counts more than
    # the noise of most names allows
    likelihood = 0.5 * np.minimum(weights, np.median(weights)) - 0.5 * squares
    best = 1 + int(np.argmax(likelihood[1:]))
    gain = float(likelihood[best] - likelihood[0])
    if gain < CAUSE + SURE:
        return []
    first, second = pairs[best - 1]
    order = _order(survey.plan.setups, first, second)
    words = message(
        "step-mismatch.exchanged",
        first=first,
        second=second,
        gain=gain,
        line="plan.setups",
        value=order,
    )
    return [finding("error", words, Place(setup=first, pass_number=1))]


def _fitted(survey: Survey, readings: Readings, assumed: Assumptions) -> tuple[float, float]:
    """Return the sum of the logarithms of the weights of a fit, and its weighted square sum."""
    settled = at_their_temperature(readings, assumed, "readings")
    fit = adjust(lay_out(readings), survey.machine.chain, assumed=settled).as_usual()
    used = fit.weight[fit.weight > 0]
    return float(np.sum(np.log(used))), fit.chi_square


def _renamed(readings: Readings, first: str, second: str) -> Readings:
    """Return readings in which two setups have exchanged names and positions."""
    names = {first: second, second: first}
    setup = tuple(names.get(name, name) for name in readings.setup)
    places = [
        list(zip(column, readings.pass_number.tolist(), readings.stop.tolist(), strict=True))
        for column in (readings.setup, setup)
    ]
    rows = {place: row for row, place in enumerate(places[0])}
    return replace(
        readings,
        setup=setup,
        position_mm=readings.position_mm[
            [rows.get(place, row) for row, place in enumerate(places[1])]
        ],
    )


def _order(setups: Sequence[str], first: str, second: str) -> str:
    """Return the setups of the plan with two exchanged, as the survey file has them."""
    names = {first: second, second: first}
    return "[" + ", ".join(f'"{names.get(name, name)}"' for name in setups) + "]"
