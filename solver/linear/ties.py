"""Choices between values that are equal but for rounding: another processor rounds differently."""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.volume import Vector

ALIKE = 1e-6
"""Relative difference below which the largest of several values is a matter of chance."""


def first_of_the_largest(values: Sequence[float] | Vector) -> int:
    """Return the place of the largest of values that are not negative: of values with differences
    below any figure, the first.
    """
    return int(np.argmax(np.asarray(values) >= (1.0 - ALIKE) * np.max(values)))
