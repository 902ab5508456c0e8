"""Checks that refuse impossible settings; the error contains the field of the survey file."""

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message


def require(condition: bool, field: str, expected: Words, found: object) -> None:
    """Raise UsageError for ``field`` (such as ``laser.sign``) if ``condition`` is False."""
    if not condition:
        raise UsageError(f"survey: {field}", expected=expected, found=repr(found))


def require_sign(sign: int) -> None:
    require(sign in (1, -1), "laser.sign", "1 or -1", sign)


def require_interferometer(wavelength_nm: float, optics: int) -> None:
    """Raise UsageError for a wavelength outside 300 to 2000 nm, or an optics factor other than 1, 2
    or 4.
    """
    require(
        300 < wavelength_nm < 2000,
        "laser.wavelength_nm",
        message("vacuum-wavelength"),
        wavelength_nm,
    )
    require(optics in (1, 2, 4), "laser.optics", "1, 2 or 4", optics)
