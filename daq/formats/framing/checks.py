"""Checks that refuse impossible settings; the error names the setting as in the survey file."""

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message


def require(condition: bool, field: str, expected: Words, found: object) -> None:
    """Raise UsageError for ``field`` (``laser.sign``) unless ``condition`` holds."""
    if not condition:
        raise UsageError(f"survey: {field}", expected=expected, found=repr(found))


def require_sign(sign: int) -> None:
    """Raise UsageError unless ``sign`` is +1 or -1."""
    require(sign in (1, -1), "laser.sign", "1 or -1", sign)


def require_interferometer(wavelength_nm: float, optics: int) -> None:
    """Raise UsageError unless the wavelength (from the 632.99 nm family to the near infrared) and
    the optics factor (1, 2 or 4) are possible.
    """
    require(
        300 < wavelength_nm < 2000,
        "laser.wavelength_nm",
        message("vacuum-wavelength"),
        wavelength_nm,
    )
    require(optics in (1, 2, 4), "laser.optics", "1, 2 or 4", optics)
