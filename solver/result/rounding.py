"""Rounding for files that must hold the same bytes wherever they are made."""

_SLACK = 3
"""Decimals beyond the wanted ones at which the last bits of a sum are taken off first."""


def steady(value: float, decimals: int) -> float:
    """Return ``value`` rounded to ``decimals``, never a negative zero; a tie goes the same way on every processor.

    Numbers made from a few exact ones lie on ties more often than chance would have it (the middle of two nodes), and there the last
    bits of a sum, which differ with the kernels of numpy's products, would decide.
    """
    return round(round(value, decimals + _SLACK), decimals) + 0.0
