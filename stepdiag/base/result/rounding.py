"""Rounding for files that must hold the same bytes wherever they are made."""

from collections.abc import Mapping
from typing import Any

ANOTHER_PROCESSOR = 1e-4
"""um and urad: a tenth of a nanometre, which nothing measures and no control resolves."""
_SLACK = 3
"""Decimals beyond the wanted ones at which the last bits of a sum are taken off first."""


def steady(value: float, decimals: int) -> float:
    """Return ``value`` rounded to ``decimals``, never a negative zero; a tie goes the same way on
    every processor.

    Numbers made from a few exact ones lie on ties more often than chance would have it (the middle
    of two nodes), and there the last bits of a sum, which differ with the kernels of numpy's
    products, would decide.
    """
    return round(round(value, decimals + _SLACK), decimals) + 0.0


def same_but_for_rounding(one: Any, other: Any, decimals: int) -> bool:
    """Return whether two JSON values differ at most by `ANOTHER_PROCESSOR` or by one in the last of
    ``decimals``, and in nothing else.

    The kernels of numpy's products change the last bits of a number; readings that hardly separate
    two unknowns amplify them, and near the edge between two roundings they push a number over: no
    rounding excludes this.
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
