"""Rounding for files that must have the same bytes on every computer."""

from collections.abc import Mapping
from typing import Any

ANOTHER_PROCESSOR = 1e-4
"""Difference in um and urad below which two results count as equal: a tenth of a nanometre, below
every measurement and every control's resolution.
"""
_SLACK = 3
"""Number of further decimals to which a number is rounded first, to remove the last bits of a sum.
"""


def steady(value: float, decimals: int) -> float:
    """Return ``value`` rounded to ``decimals``, never a negative zero; a tie is rounded in the same
    direction on every processor.

    Numbers computed from a few exact numbers are often ties (the middle of two nodes). Without the
    first rounding, the last bits of a sum would decide the rounding of a tie, and they differ
    between processors.
    """
    return round(round(value, decimals + _SLACK), decimals) + 0.0


def same_but_for_rounding(one: Any, other: Any, decimals: int) -> bool:
    """Return whether two JSON values differ at most by `ANOTHER_PROCESSOR` or by one in the last of
    ``decimals``, and in no other way.

    The kernels of numpy's products change the last bits of a number. Readings that hardly separate
    two unknowns amplify this change, and near the limit between two roundings it changes the
    rounded number: no rounding prevents this.
    """
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return list(one) == list(other) and all(
            same_but_for_rounding(one[key], other[key], decimals) for key in one
        )
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(
            same_but_for_rounding(a, b, decimals) for a, b in zip(one, other, strict=True)
        )
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) < max(ANOTHER_PROCESSOR, 1.5 * 10.0**-decimals)
    return bool(one == other)
