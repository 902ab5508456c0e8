"""Coverage factors for many simultaneous differences (Sidak, Bonferroni)."""

from statistics import NormalDist
from typing import Literal

Verdict = Literal["changed", "unchanged", "undecided"]
"""Verdict about a quantity. Changed: the change is more than chance. Unchanged: a change of three U
is excluded. Undecided: neither."""

ERRS = 2 * (1 - NormalDist().cdf(2.0))
"""Probability that an unchanged machine is reported as changed, for all its quantities together:
4.6 %, as for a single quantity with k = 2."""
EXCLUDED = 3.1
"""A change is excluded if it exceeds the estimate by this number of standard uncertainties; one
exclusion in a thousand is wrong."""
DENIABLE = 3.0
"""Largest change that the verdict "unchanged" can hide, in multiples of U."""


def coverage_factor(questions: int) -> float:
    """Return the factor k for many independent differences: the probability that one of them
    exceeds k u is that of a single difference beyond k = 2 (Sidak)."""
    single = 1 - (1 - ERRS) ** (1 / max(questions, 1))
    return NormalDist().inv_cdf(1 - single / 2)
