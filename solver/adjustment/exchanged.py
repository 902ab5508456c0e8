"""Two setups with exchanged names.

The steps of two diagonals can have the same lengths, so that the laser's steps fit either name. The
readings of all setups agree on one machine only with the right names. The evidence of an exchange
is its gain in likelihood (`solver.adjustment.evidence`). An exchange also explains part of a large
step, so the odds of the exchange are compared with those of the wrong stops, steps and wandering
passes in the same fit.
"""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import counts
from stepdiag.solver.adjustment.evidence import EXCHANGED, ODDS, log_prior, response_of
from stepdiag.solver.adjustment.faults import most_odds
from stepdiag.solver.linear.components import gained
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.layout import Layout


def exchange(usual: MixedFit, layout: Layout) -> tuple[tuple[int, int], Vector] | None:
    """Return the two setups whose names were exchanged, and the change of the target (rows,) by the
    exchange. The odds of the exchange must be `ODDS` times those of no exchange and higher than
    those of every fault of a pass; the result is None if no pair has these odds.

    In the fit ``usual`` every random effect is limited to its usual size, so that no effect hides
    an exchange.
    """
    every = list(_pairs(layout))
    if not every:
        return None
    changes = np.zeros((len(usual.weight), len(every)))
    for column, (_, first, second) in enumerate(every):
        moved_um = layout.deviation_um[second] - layout.deviation_um[first]
        changes[first, column], changes[second, column] = moved_um, -moved_um
    response = response_of(usual, np.arange(len(changes)), changes)
    left = usual.chi_square + 2.0 * response.shown + np.diag(response.seen)
    odds = 0.5 * gained(usual, left) + log_prior(EXCHANGED, len(every))
    best = int(np.argmax(odds))
    against = odds[best] - np.log(ODDS)
    if against <= 0.0 or against <= most_odds(usual, counts(usual.fixed, layout)):
        return None
    return every[best][0], changes[:, best]


def _pairs(
    layout: Layout,
) -> Iterator[tuple[tuple[int, int], NDArray[np.int64], NDArray[np.int64]]]:
    """Yield each pair of diagonals with the same passes, stops and step lengths, and the rows of
    both."""
    rows = [
        np.flatnonzero(layout.setup_index == index) for index in range(len(layout.setups))
    ]
    number = np.array([key.number for key in layout.passes])[layout.pass_index]
    diagonal = [index for index, setup in enumerate(layout.setups) if setup.kind != "linear"]
    for first, second in combinations(diagonal, 2):
        mine, other = rows[first], rows[second]
        alike = len(mine) == len(other) > 0 and all(
            np.array_equal(of[mine], of[other]) for of in (number, layout.stop)
        )
        if alike and np.allclose(
            np.abs(layout.direction[mine[0]]), np.abs(layout.direction[other[0]])
        ):
            yield (first, second), mine, other
