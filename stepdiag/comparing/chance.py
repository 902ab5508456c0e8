"""Differences that chance alone explains: normal quantiles for many simultaneous questions (Sidak,
Bonferroni).
"""

from statistics import NormalDist
from typing import Literal

Verdict = Literal["changed", "unchanged", "undecided"]
"""The verdict on a quantity. Changed: more than chance. Unchanged: no change of three U is
possible. Undecided: neither.
"""

ERRS = 2 * (1 - NormalDist().cdf(2.0))
"""Chance that an unchanged machine is reported as changed, for all its quantities together: as for
a single quantity with k = 2, 4.6 %.
"""
EXCLUDED = 3.1
"""A change that is larger than its estimate by this number of standard uncertainties is excluded,
except for one in a thousand.
"""
DENIABLE = 3.0
"""Multiple of U up to which a change may stay hidden in the verdict "unchanged"."""


def coverage_factor(questions: int) -> float:
    """Return the factor k for many independent differences: the chance that one of them exceeds k u
    is that of a single difference beyond k = 2 (Sidak).
    """
    single = 1 - (1 - ERRS) ** (1 / max(questions, 1))
    return NormalDist().inv_cdf(1 - single / 2)
