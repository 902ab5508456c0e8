"""Choices between values that are equal except for rounding: another processor rounds
differently.
"""

from collections.abc import Sequence

import numpy as np

from stepdiag.base.volume import Vector

ALIKE = 1e-6
"""Relative difference below which the largest of several values is a matter of chance."""


def first_of_the_largest(values: Sequence[float] | Vector) -> int:
    """Return the index of the largest of non-negative values; of values whose difference is only
    rounding, the first.
    """
    return int(np.argmax(np.asarray(values) >= (1.0 - ALIKE) * np.max(values)))
