"""Rounding for files with the same bytes on every computer."""

from collections.abc import Mapping
from typing import Any

ANOTHER_PROCESSOR = 1e-4
"""Difference in um or urad below which two results count as equal: 0.1 nm is below every
measurement and below the resolution of every control."""
_SLACK = 3
"""A value is first rounded to this number of further decimals, which removes the last bits of a
sum."""


def steady(value: float, decimals: int) -> float:
    """Return ``value`` rounded to ``decimals``, never a negative zero; a tie is rounded in the same
    direction on every processor.

    Numbers computed from a few exact numbers are often ties (for example the middle of two nodes).
    The last bits of a sum differ between processors and would decide the rounding of a tie.
    """
    return round(round(value, decimals + _SLACK), decimals) + 0.0


def same_but_for_rounding(one: Any, other: Any, decimals: int) -> bool:
    """Return whether two JSON values differ only in numbers, by at most `ANOTHER_PROCESSOR` or one
    unit in the last of ``decimals``.

    The last bits of a matrix product differ between processors. Readings that hardly separate two
    unknowns amplify this difference, so the rounded number can differ.
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
