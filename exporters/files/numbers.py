"""Text of numbers in files for controls: with a decimal point in any locale, and never a negative
zero.
"""


def fixed(value: float, decimals: int) -> str:
    """Return ``value`` with exactly ``decimals`` places; a value that rounds to zero has no
    sign."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def shortest(value: float) -> str:
    """Return a position in mm with the fewest digits whose error is below 1e-9 mm, and at least one
    decimal: ``-200.0``, ``6.25``.
    """
    whole, _, fraction = fixed(value, 9).partition(".")
    return f"{whole}.{fraction.rstrip('0') or '0'}"
