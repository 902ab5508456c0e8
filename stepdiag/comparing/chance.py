"""Differences that chance alone explains: normal quantiles for many simultaneous questions (Sidak,
Bonferroni).
"""

from statistics import NormalDist
from typing import Literal

Verdict = Literal["changed", "unchanged", "undecided"]
"""Of one quantity: more than chance, no change of three U hidden, or neither."""

ERRS = 2 * (1 - NormalDist().cdf(2.0))
"""Chance that an unchanged machine is reported as changed, over all its questions together: the
chance of k = 2, 4.6 %.
"""
EXCLUDED = 3.1
"""A change so many standard uncertainties above its estimate is excluded but for one in a
thousand."""
DENIABLE = 3.0
"""A change up to so many U may hide behind "unchanged"; a larger one must not."""


def coverage_factor(questions: int) -> float:
    """Return the k beyond which one of so many independent differences lies as seldom as a single
    difference beyond k = 2 (Sidak).
    """
    single = 1 - (1 - ERRS) ** (1 / max(questions, 1))
    return NormalDist().inv_cdf(1 - single / 2)
