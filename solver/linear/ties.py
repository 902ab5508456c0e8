"""What is equal but for rounding must not be chosen by it: another processor rounds otherwise."""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.volume import Vector

ALIKE = 1e-6
"""Which of several is the largest is chance beyond so many parts of it."""


def first_of_the_largest(values: Sequence[float] | Vector) -> int:
    """Return the place of the largest of values that are not negative: of those that differ by less than any figure shows, the first."""
    return int(np.argmax(np.asarray(values) >= (1.0 - ALIKE) * np.max(values)))
