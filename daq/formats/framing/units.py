"""Units of length of the instruments."""

from collections.abc import Mapping
from typing import Literal

Unit = Literal["mm", "um", "nm", "pm", "inch", "counts"]
_MM_PER_UNIT: Mapping[str, float] = {
    "mm": 1.0,
    "um": 1e-3,
    "nm": 1e-6,
    "pm": 1e-9,
    "inch": 25.4,
}


def mm_per_unit(unit: Unit, wavelength_nm: float, optics: int) -> float:
    """Return the length of a unit in mm; the unit ``counts`` is half a vacuum wavelength divided by
    ``optics``.
    """
    return wavelength_nm * 1e-6 / 2 / optics if unit == "counts" else _MM_PER_UNIT[unit]
