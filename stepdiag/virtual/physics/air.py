"""The refractive index of moist air after Ciddor (Applied Optics 35 (1996) 1566, and NIST
Engineering Metrology Toolbox, Appendix A)."""

import math

_DRY_AIR_KG_PER_MOL = 0.0289635 + 1.2011e-8 * (450.0 - 400.0)
_GAS_CONSTANT = 8.314472


def saturation_pressure_pa(temperature_c: float) -> float:
    """Return the saturation vapour pressure over water (IAPWS-IF97, NIST form)."""
    kelvin = temperature_c + 273.15
    omega = kelvin - 0.238555575678 / (kelvin - 650.175348448)
    a = omega**2 + 1.16705214528e3 * omega - 7.24213167032e5
    b = -17.0738469401 * omega**2 + 1.20208247025e4 * omega - 3.23255503223e6
    c = 14.9151086135 * omega**2 - 4.82326573616e3 * omega + 4.05113405421e5
    x = -b + math.sqrt(b * b - 4 * a * c)
    return 1e6 * (2 * c / x) ** 4


def _compressibility(pressure_pa: float, temperature_c: float, water: float) -> float:
    t, kelvin = temperature_c, temperature_c + 273.15
    ratio = pressure_pa / kelvin
    first = 1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t * t
    second = (5.707e-6 - 2.051e-8 * t) * water + (1.9898e-4 - 2.376e-6 * t) * water**2
    return 1.0 - ratio * (first + second) + ratio**2 * (1.83e-11 - 0.765e-8 * water**2)


def refractive_index(
    temperature_c: float,
    pressure_hpa: float,
    humidity_percent: float,
    wavelength_nm: float = 632.991,
) -> float:
    """Return the phase index of air with 450 ppm CO2 at a vacuum wavelength."""
    pressure = pressure_hpa * 100.0
    kelvin = temperature_c + 273.15
    wave = (1e3 / wavelength_nm) ** 2
    dry = 1e-8 * (5792105.0 / (238.0185 - wave) + 167917.0 / (57.362 - wave))
    vapour = 1.022e-8 * (295.235 + 2.6422 * wave - 0.03238 * wave**2 + 0.004028 * wave**3)
    enhancement = 1.00062 + 3.14e-8 * pressure + 5.6e-7 * temperature_c**2
    water = (
        humidity_percent
        / 100.0
        * enhancement
        * saturation_pressure_pa(temperature_c)
        / pressure
    )
    density = (
        pressure
        * _DRY_AIR_KG_PER_MOL
        / (_GAS_CONSTANT * kelvin * _compressibility(pressure, temperature_c, water))
    )
    dry_density = density * (1.0 - water)
    water_density = density * water * 0.018015 / _DRY_AIR_KG_PER_MOL
    standard_density = (
        101325.0 * _DRY_AIR_KG_PER_MOL / (0.9995922115 * _GAS_CONSTANT * 288.15)
    )
    return 1.0 + dry * dry_density / standard_density + vapour * water_density / 0.00985938
