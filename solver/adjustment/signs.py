"""Test of the signs of known angular functions, before the search for wrong readings.

A reversed sign is a linear change of the expected readings. The estimated size of this change is 1
for a wrong sign and 0 for a right sign.
"""

from collections.abc import Mapping

import numpy as np

from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.evidence import ODDS, TURNED, log_prior
from stepdiag.solver.linear.components import likelier
from stepdiag.solver.linear.mixed import MixedFit

BETTER = 2.0 * (float(np.log(ODDS)) - log_prior(TURNED, 1))
"""Twice the gain in log-likelihood at which the odds of a reversed sign are `ODDS`."""
LEAST, MOST = 0.6, 1.6
"""Range of the estimated size of the change for a wrong sign."""


def wrong_signs(current: MixedFit, turned: Mapping[str, Vector]) -> list[str]:
    """Return the functions whose reversed sign makes the readings significantly more likely.

    ``turned`` contains the change of the fit's target by each reversed sign, shape (rows,).
    """
    names = [name for name in turned if _square(current, turned[name]) > BETTER]
    target = current.fixed.target
    while names:
        changes = [turned[name] for name in names]
        # the product of two changes, computed from the squares of their sum and difference
        form = (
            np.array(
                [
                    [
                        _square(current, one + two) - _square(current, one - two)
                        for two in changes
                    ]
                    for one in changes
                ]
            )
            / 4.0
        )
        against = (
            np.array(
                [
                    _square(current, target + one) - _square(current, target - one)
                    for one in changes
                ]
            )
            / 4.0
        )
        sizes = -np.linalg.lstsq(form, against, rcond=None)[0]
        meant = [
            name
            for name, size in zip(names, sizes.tolist(), strict=True)
            if LEAST <= size <= MOST
        ]
        if len(meant) == len(names):
            break
        names = meant
    whole = current.for_target(target + sum(turned[name] for name in names))
    return [
        name
        for name in names
        if likelier(whole, current.for_target(whole.fixed.target - turned[name])) > BETTER
    ]


def unseen_signs(current: MixedFit, turned: Mapping[str, Vector]) -> list[str]:
    """Return the functions whose reversed sign has no visible effect on the readings; ``turned``
    as in `wrong_signs`."""
    return [name for name, change in turned.items() if _square(current, change) <= BETTER]


def _square(current: MixedFit, target: Vector) -> float:
    return current.for_target(target).chi_square
