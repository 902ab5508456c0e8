"""The 21 geometric errors of a three-axis machine: smooth, tabulated or zero (ISO 230-1 names and
signs, contract 1)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ErrorFunction = Callable[[Array], Array]
"""A function from positions of an axis in mm, shape (N,), to an error in um (displacements) or urad
(rotations), shape (N,)."""

AXES = "XYZ"
DISPLACEMENTS = tuple(f"E{component}{axis}" for axis in AXES for component in "XYZ")
ROTATIONS = tuple(f"E{component}{axis}" for axis in AXES for component in "ABC")
SQUARENESS = ("C0Y", "B0Z", "A0Z")


@dataclass(frozen=True, slots=True)
class Smooth:
    """An error function: a sum of half waves over the travel plus a straight line, continued
    smoothly beyond the ends.

    ``value = slope * (p - low) + sum_k amplitude[k] sin((k + 1) pi (p - low) / length)``: every
    half wave is zero at both ends, so the end-point line is exactly ``slope``.
    """

    low_mm: float
    length_mm: float
    amplitudes: tuple[float, ...]
    slope_per_mm: float = 0.0

    def __call__(self, position_mm: Array) -> Array:
        travelled = np.asarray(position_mm, dtype=np.float64) - self.low_mm
        value = self.slope_per_mm * travelled
        for harmonic, amplitude in enumerate(self.amplitudes, start=1):
            value = value + amplitude * np.sin(harmonic * np.pi / self.length_mm * travelled)
        return value


@dataclass(frozen=True, slots=True)
class Table:
    """An error function that is linear between nodes and constant beyond them."""

    position_mm: tuple[float, ...]
    value: tuple[float, ...]

    def __call__(self, position_mm: Array) -> Array:
        return np.interp(position_mm, self.position_mm, self.value)


@dataclass(frozen=True, slots=True)
class Waved:
    """An error function plus a periodic error, as of a ball screw or a scale, which is zero at
    ``low_mm``."""

    base: ErrorFunction
    amplitude: float
    period_mm: float
    phase_rad: float
    low_mm: float = 0.0

    def __call__(self, position_mm: Array) -> Array:
        turns = (
            2.0
            * np.pi
            / self.period_mm
            * (np.asarray(position_mm, dtype=np.float64) - self.low_mm)
        )
        value: Array = self.base(position_mm) + self.amplitude * (
            np.sin(turns + self.phase_rad) - np.sin(self.phase_rad)
        )
        return value


def zero(position_mm: Array) -> Array:
    """Return zeros, shape like ``position_mm``: the function of a missing error."""
    return np.zeros_like(position_mm, dtype=np.float64)


def smooth(
    rng: np.random.Generator,
    low_mm: float,
    length_mm: float,
    amplitude: float,
    tilt: float = 0.0,
) -> Smooth:
    """Draw a smooth error function whose largest deviation from its end-point line is
    ``amplitude``.

    ``tilt`` is the rise of the end-point line over the travel, in the unit of ``amplitude``.
    """
    weights = rng.normal(size=5) / np.arange(1, 6)
    shape = Smooth(0.0, 1.0, tuple(weights))
    peak = float(np.max(np.abs(shape(np.linspace(0.0, 1.0, 501)))))
    return Smooth(low_mm, length_mm, tuple(weights * (amplitude / peak)), tilt / length_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Amplitudes:
    """Sizes of the random errors: largest deviations in um and urad; the size of a scale is at most
    ``scale_um_m``."""

    positioning_um: float = 8.0
    straightness_um: float = 8.0
    angle_urad: float = 0.0
    scale_um_m: float = 15.0
    squareness_urad: float = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSet:
    """All errors of a machine, as errors of the tool relative to the work, actual minus commanded.

    ``functions`` contains any of the 18 functions (missing functions are zero), ``squareness_urad``
    any of the three squareness errors. Half of ``reversal`` is added after a move of the axis in +,
    and subtracted after a move in -.
    """

    low_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    functions: Mapping[str, ErrorFunction] = field(default_factory=dict)
    squareness_urad: Mapping[str, float] = field(default_factory=dict)
    reversal: Mapping[str, ErrorFunction] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _refuse_unknown((*self.functions, *self.reversal), (*DISPLACEMENTS, *ROTATIONS))
        _refuse_unknown(self.squareness_urad, SQUARENESS)

    def displacement_um(self, axis: int, position_mm: Array, direction: Array) -> Array:
        """Return the displacement of carriage ``axis`` (0, 1, 2), including the lines of its
        squareness errors, shape (N, 3)."""
        value = self._components("XYZ", axis, position_mm, direction)
        travelled_m = (np.asarray(position_mm, dtype=np.float64) - self.low_mm[axis]) * 1e-3
        if AXES[axis] == "Y":
            value[:, 0] -= self.squareness_urad.get("C0Y", 0.0) * travelled_m
        if AXES[axis] == "Z":
            value[:, 0] += self.squareness_urad.get("B0Z", 0.0) * travelled_m
            value[:, 1] -= self.squareness_urad.get("A0Z", 0.0) * travelled_m
        return value

    def rotation_urad(self, axis: int, position_mm: Array, direction: Array) -> Array:
        """Return the rotation of carriage ``axis`` about X, Y, Z, shape (N, 3)."""
        return self._components("ABC", axis, position_mm, direction)

    def _components(
        self, letters: str, axis: int, position_mm: Array, direction: Array
    ) -> Array:
        columns = []
        for letter in letters:
            name = f"E{letter}{AXES[axis]}"
            reversal = 0.5 * direction * self.reversal.get(name, zero)(position_mm)
            columns.append(self.functions.get(name, zero)(position_mm) + reversal)
        return np.stack(columns, axis=-1)


def _refuse_unknown(names: Iterable[str], known: tuple[str, ...]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"expected one of {', '.join(known)}, found {name}")


def random_errors(
    seed: int,
    low_mm: tuple[float, float, float],
    size_mm: tuple[float, float, float],
    amplitudes: Amplitudes | None = None,
) -> ErrorSet:
    """Draw the errors of a machine by ``seed``: nine displacement and nine angular functions,
    scales and squareness of random sign."""
    wanted = amplitudes or Amplitudes()
    rng = np.random.default_rng(seed)
    functions: dict[str, ErrorFunction] = {}
    for axis, (letter, low, length) in enumerate(zip(AXES, low_mm, size_mm, strict=True)):
        for component in range(3):
            own = component == axis
            amplitude = wanted.positioning_um if own else wanted.straightness_um
            scale_um = rng.uniform(-1.0, 1.0) * wanted.scale_um_m * length * 1e-3
            functions[f"E{AXES[component]}{letter}"] = smooth(
                rng, low, length, amplitude, scale_um if own else 0.0
            )
        for about in "ABC":
            tilt = rng.uniform(-0.5, 0.5) * wanted.angle_urad
            functions[f"E{about}{letter}"] = smooth(
                rng, low, length, wanted.angle_urad / 2.0, tilt
            )
    signs = rng.choice([-1.0, 1.0], size=3)
    squareness = {
        name: float(sign * wanted.squareness_urad)
        for name, sign in zip(SQUARENESS, signs, strict=True)
    }
    return ErrorSet(
        low_mm=low_mm, size_mm=size_mm, functions=functions, squareness_urad=squareness
    )
