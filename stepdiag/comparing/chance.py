"""Differences that chance alone explains: normal quantiles for many simultaneous questions (Sidak,
Bonferroni).
"""

from statistics import NormalDist
from typing import Literal

Verdict = Literal["changed", "unchanged", "undecided"]
"""Verdicts on one quantity: more than chance, no change of three U possible, or neither."""

ERRS = 2 * (1 - NormalDist().cdf(2.0))
"""Chance that an unchanged machine is reported as changed, for all its quantities together: the
chance of k = 2, 4.6 %.
"""
EXCLUDED = 3.1
"""Number of standard uncertainties above its estimate beyond which a change is excluded, except for
one in a thousand.
"""
DENIABLE = 3.0
"""Multiple of U up to which a change may be hidden behind "unchanged"; a larger one must not."""


def coverage_factor(questions: int) -> float:
    """Return the k beyond which one of many independent differences lies as rarely as a single
    difference beyond k = 2 (Sidak).
    """
    single = 1 - (1 - ERRS) ** (1 / max(questions, 1))
    return NormalDist().inv_cdf(1 - single / 2)
