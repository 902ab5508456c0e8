"""What a result states beside the truth of an exact machine."""

from typing import NamedTuple

import numpy as np

from stepdiag.base.result.result import DISPLACEMENTS, SQUARENESS, Result
from stepdiag.virtual.physics.machine import Machine


class Told(NamedTuple):
    """A true figure and what was predicted of it."""

    true: float
    value: float
    low: float
    high: float

    @property
    def inside(self) -> bool:
        """Tell whether the interval holds it."""
        return self.low <= self.true <= self.high

    @property
    def used(self) -> float:
        """Return how much of the interval's side it uses up: 1 at its end."""
        side = self.high - self.value if self.true > self.value else self.value - self.low
        return abs(self.true - self.value) / max(side, 1e-9)


def within(result: Result, machine: Machine, increments: int) -> dict[str, list[bool]]:
    """Return whether each true value lies within 2 u, by class of quantity."""
    truth = machine.truth(increments)
    found: dict[str, list[bool]] = {"functions": [], "squareness": [], "scale": []}
    for name in DISPLACEMENTS:
        function = result.errors[name]
        if function.value is not None and function.u is not None:
            told, true = function.u > 1e-9, truth.errors[name]
            if not function.slope_identified:
                true = true - true[-1] * np.linspace(0.0, 1.0, len(true))
            found["functions"] += (
                np.abs(function.value - true)[told] <= 2 * function.u[told]
            ).tolist()
    for name in SQUARENESS:
        number = result.squareness[name]
        if number.value is not None and number.u is not None:
            found["squareness"].append(
                abs(number.value - truth.squareness_urad[name]) <= 2 * number.u
            )
    for axis, scale in result.scale.items():
        if scale.value is not None and scale.u is not None:
            found["scale"].append(abs(scale.value - truth.scale_um_m[axis]) <= 2 * scale.u)
    return found
