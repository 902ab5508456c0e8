"""Temperatures, pressure and humidity in the hall over machine time."""

from dataclasses import dataclass, field

import numpy as np

from stepdiag.virtual.physics.air import refractive_index
from stepdiag.virtual.physics.error_functions import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """A quantity over time: a start value, a steady change and an oscillation."""

    start: float
    per_hour: float = 0.0
    swing: float = 0.0
    period_h: float = 1.0

    def at(self, time_s: Array) -> Array:
        """Return the value of the quantity at each time, shape like ``time_s``."""
        hours = np.asarray(time_s, dtype=np.float64) / 3600.0
        value: Array = (
            self.start
            + self.per_hour * hours
            + self.swing * np.sin(2 * np.pi * hours / self.period_h)
        )
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """The course of the air in the beam and of the material of the machine."""

    material_c: Course = field(default_factory=lambda: Course(start=20.0))
    air_c: Course = field(default_factory=lambda: Course(start=20.0))
    pressure_hpa: Course = field(default_factory=lambda: Course(start=1013.25))
    humidity_percent: Course = field(default_factory=lambda: Course(start=50.0))

    def index(self, time_s: Array, wavelength_nm: float) -> Array:
        """Return the refractive index of the air at each time, shape (N,).

        The index is computed at up to 200 times and interpolated between them (error below 1e-11),
        because air changes slowly.
        """
        times = np.asarray(time_s, dtype=np.float64)
        if len(times) == 0:
            return times
        grid = (
            np.unique(times)
            if len(times) <= 200
            else np.linspace(times.min(), times.max(), 200)
        )
        index = [
            refractive_index(air_c, pressure_hpa, humidity, wavelength_nm)
            for air_c, pressure_hpa, humidity in zip(
                self.air_c.at(grid),
                self.pressure_hpa.at(grid),
                self.humidity_percent.at(grid),
                strict=True,
            )
        ]
        return np.interp(times, grid, index)
