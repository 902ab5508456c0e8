"""The refractive index of air and its effect on a length measured by an interferometer.

Both equations (modified Edlen; Ciddor 1996) use the IAPWS saturation vapour pressure. They are
checked against the values that NIST publishes, and differ from each other by less than 3e-8 in a
machine hall. The modified Edlen equation is that of Birch and Downs 1994 with the water term of the
NIST Engineering Metrology Toolbox, Appendix A.
"""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message

Vector = NDArray[np.float64]

ZERO_CELSIUS_K = 273.15
CIDDOR_CO2_PPM = 450.0
"""Carbon dioxide content of the air in ppm for which NIST publishes values of the index."""

_PLAUSIBLE = {
    "air_temperature_c": (-40.0, 100.0),
    "air_pressure_hpa": (100.0, 1400.0),
    "relative_humidity_percent": (0.0, 100.0),
}

HALL = {
    "material_temperature_c": (0.0, 60.0),
    "air_temperature_c": (0.0, 60.0),
    "air_pressure_hpa": (600.0, 1100.0),
    "relative_humidity_percent": (0.0, 100.0),
}
"""Possible values of the air and the material in a machine hall: above the first number, up to the
second. A register that was never written contains 0; a sensor that sends kPa gives 101 as the
pressure."""


class Done(enum.Flag):
    """The corrections that the instrument has already made to its length.

    ``WAVELENGTH``: the length is divided by the present index of the air. ``DEAD_PATH``: the length
    is corrected for the air in the dead path. ``EXPANSION``: the length is reduced to a material
    temperature of 20 C.
    """

    NOTHING = 0
    WAVELENGTH = enum.auto()
    DEAD_PATH = enum.auto()
    EXPANSION = enum.auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """The air in the beam: scalars or arrays of one shape. Raises DataError for values that are
    impossible for air."""

    temperature_c: Vector
    pressure_hpa: Vector
    humidity_percent: Vector

    def __post_init__(self) -> None:
        fields = zip(
            ("temperature_c", "pressure_hpa", "humidity_percent"),
            _PLAUSIBLE.items(),
            strict=True,
        )
        for name, (signal, (low, high)) in fields:
            values = np.asarray(getattr(self, name), dtype=np.float64)
            implausible = ~((values >= low) & (values <= high))
            if implausible.any():
                raise DataError(
                    f"environment: {signal}",
                    expected=message("range-of-figures", low=low, high=high),
                    found=f"{values[implausible].flat[0]:g}",
                    remedy=message("check-sensor-its-register"),
                )
            object.__setattr__(self, name, values)


def saturation_pressure_pa(temperature_c: ArrayLike) -> Vector:
    """Return the saturation vapour pressure over water (IAPWS; NIST toolbox, Appendix A)."""
    k1, k2, k3, k4, k5 = (
        1.16705214528e3,
        -7.24213167032e5,
        -17.0738469401,
        1.20208247025e4,
        -3.23255503223e6,
    )
    k6, k7, k8, k9, k10 = (
        14.9151086135,
        -4.82326573616e3,
        4.05113405421e5,
        -0.238555575678,
        650.175348448,
    )
    kelvin = np.asarray(temperature_c, dtype=np.float64) + ZERO_CELSIUS_K
    w = kelvin + k9 / (kelvin - k10)
    a = w**2 + k1 * w + k2
    b = k3 * w**2 + k4 * w + k5
    c = k6 * w**2 + k7 * w + k8
    x = -b + np.sqrt(b**2 - 4 * a * c)
    pressure: Vector = 1e6 * (2 * c / x) ** 4
    return pressure


def edlen_index(air: Air, vacuum_wavelength_nm: float) -> Vector:
    """Return the refractive index by the modified Edlen equation (NIST toolbox, Appendix A, part
    II), shape of ``air``."""
    s = (1e3 / vacuum_wavelength_nm) ** 2
    t, p = air.temperature_c, air.pressure_hpa * 100.0
    standard = 1e-8 * (8342.54 + 2406147 / (130 - s) + 15998 / (38.9 - s))
    density = (1 + 1e-8 * (0.601 - 0.00972 * t) * p) / (1 + 0.003661 * t)
    dry = p * standard * density / 96095.43
    vapour_pa = air.humidity_percent / 100 * saturation_pressure_pa(t)
    water = 1e-10 * (292.75 / (t + ZERO_CELSIUS_K)) * (3.7345 - 0.0401 * s) * vapour_pa
    index: Vector = 1 + dry - water
    return index


def _ciddor_compressibility(t: Vector, p: Vector, xv: Vector) -> Vector:
    kelvin = t + ZERO_CELSIUS_K
    first = 1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2
    first = first + (5.707e-6 - 2.051e-8 * t) * xv + (1.9898e-4 - 2.376e-6 * t) * xv**2
    ratio = p / kelvin
    z: Vector = 1 - ratio * first + ratio**2 * (1.83e-11 - 0.765e-8 * xv**2)
    return z


def ciddor_index(
    air: Air, vacuum_wavelength_nm: float, co2_ppm: float = CIDDOR_CO2_PPM
) -> Vector:
    """Return the refractive index by Ciddor's equation (NIST toolbox, Appendix A, part I), shape of
    ``air``."""
    s = (1e3 / vacuum_wavelength_nm) ** 2
    t, p = air.temperature_c, air.pressure_hpa * 100.0
    vapour_pa = air.humidity_percent / 100 * saturation_pressure_pa(t)
    xv = (1.00062 + 3.14e-8 * p + 5.6e-7 * t**2) * vapour_pa / p
    dry_standard = (
        1e-8
        * (5792105 / (238.0185 - s) + 167917 / (57.362 - s))
        * (1 + 5.34e-7 * (co2_ppm - 450))
    )
    water_standard = 1.022e-8 * (295.235 + 2.6422 * s - 0.03238 * s**2 + 0.004028 * s**3)
    water_molar, gas = 0.018015, 8.314472
    moles = p / (_ciddor_compressibility(t, p, xv) * gas * (t + ZERO_CELSIUS_K))
    # the equation needs the ratio of two densities, dry air to standard air: the molar mass of dry
    # air cancels
    standard_moles = 101325 / (0.9995922115 * gas * 288.15)
    dry = (1 - xv) * moles / standard_moles * dry_standard
    water = xv * moles * water_molar / 0.00985938 * water_standard
    index: Vector = 1 + dry + water
    return index


IndexEquation = Literal["edlen", "ciddor"]
_EQUATIONS: dict[IndexEquation, Callable[[Air, float], Vector]] = {
    "edlen": edlen_index,
    "ciddor": ciddor_index,
}


def refractive_index(
    air: Air, vacuum_wavelength_nm: float, equation: IndexEquation = "edlen"
) -> Vector:
    """Return the refractive index by the equation of this name, shape of ``air``."""
    return _EQUATIONS[equation](air, vacuum_wavelength_nm)


def correction_factor(index: ArrayLike, done: Done) -> Vector:
    """Return, for each stop, the factor from the length that the instrument reports to the true
    length in this air, shape (N,)."""
    n = np.asarray(index, dtype=np.float64)
    factor: Vector = np.ones_like(n) if Done.WAVELENGTH in done else 1 / n
    return factor


def displacement_mm(
    reading_mm: ArrayLike,
    index: ArrayLike,
    *,
    zero_index: float,
    dead_path_mm: float,
    done: Done,
) -> Vector:
    """Return the true displacement of the target at every stop in mm, shape (N,).

    ``reading_mm`` is relative to the first stop of the pass and grows away from the laser.
    ``index`` (N,) is the refractive index at each stop, ``zero_index`` the index at the first stop.
    ``done`` contains the corrections that the instrument has already made.

    An instrument that counts vacuum wavelengths reads ``n (D + L) - n0 D``. ``D`` is the dead path:
    the distance from the interferometer to the target at the first stop (Agilent 5530 manual,
    "deadpath distance").
    """
    n = np.asarray(index, dtype=np.float64)
    lengths: Vector = np.asarray(reading_mm, dtype=np.float64) * correction_factor(n, done)
    if Done.DEAD_PATH not in done:
        lengths = lengths - dead_path_mm * (n - zero_index) / n
    return lengths


EQUATION_U = 1e-8
"""Standard uncertainty of the two equations of the refractive index (RECALLED: Birch and Downs,
Metrologia 31 (1994) 315).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class AirUncertainty:
    """Standard uncertainties (k = 1) of temperature, pressure and humidity of the air in the
    beam."""

    temperature_c: float
    pressure_hpa: float
    humidity_percent: float


def index_u(air: Air, vacuum_wavelength_nm: float, u: AirUncertainty) -> Vector:
    """Return the standard uncertainty of the refractive index, shape of ``air`` (GUM 5.1:
    sensitivities by central difference).
    """
    total = np.full(
        np.shape(air.temperature_c + air.pressure_hpa + air.humidity_percent), EQUATION_U**2
    )
    for name, half, step_u in (
        ("temperature_c", 0.05, u.temperature_c),
        ("pressure_hpa", 0.5, u.pressure_hpa),
        ("humidity_percent", 0.5, u.humidity_percent),
    ):
        total = total + (_sensitivity(air, vacuum_wavelength_nm, name, half) * step_u) ** 2
    result: Vector = np.sqrt(total)
    return result


def _sensitivity(air: Air, vacuum_wavelength_nm: float, name: str, half: float) -> Vector:
    state = {
        field: getattr(air, field)
        for field in ("temperature_c", "pressure_hpa", "humidity_percent")
    }
    low_limit, high_limit = list(_PLAUSIBLE.values())[list(state).index(name)]
    low = np.maximum(state[name] - half, low_limit)
    high = np.minimum(state[name] + half, high_limit)
    above = edlen_index(Air(**{**state, name: high}), vacuum_wavelength_nm)
    below = edlen_index(Air(**{**state, name: low}), vacuum_wavelength_nm)
    slope: Vector = (above - below) / (high - low)
    return slope
