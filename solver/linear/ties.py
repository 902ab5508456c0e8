"""A choice between nearly equal values that does not depend on the rounding of the processor."""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.volume import Vector

ALIKE = 1e-6
"""Relative difference below which two values are treated as equal."""


def first_of_the_largest(values: Sequence[float] | Vector) -> int:
    """Return the index of the largest of non-negative values; of equal values, the index of the
    first."""
    return int(np.argmax(np.asarray(values) >= (1.0 - ALIKE) * np.max(values)))
