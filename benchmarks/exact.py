"""An independent exact least squares: what the best estimator could reach that knows how large
everything usually is on this machine.

Nothing of the solver is in it. Its model of a reading is the virtual machine itself: the nine
functions as tables at the targets, the nine angular functions as sums of half waves, mirrors that
lean. The readings' weights and the true usual size of each wave are its only prior. The derivatives
are differences of that machine's readings; Gauss-Newton steps hold the readings against it exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import (
    AXES,
    DISPLACEMENTS,
    ROTATIONS,
    ErrorSet,
    Smooth,
    Table,
    smooth,
)
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.measured import simulate_pass

Array = NDArray[np.float64]
WAVES = 5
STEPS = 3
_SMALL = 1.0
"""Step of the differences, in um, urad and tenths of a milliradian: the model is linear within far
more."""
_FREE = 1e4


@dataclass(frozen=True, kw_only=True)
class ExactModel:
    """The unknowns of a class of surveys: a vector of node values (um), angular amplitudes (urad),
    leans (0.1 mrad), zeros (um)."""

    box: Box
    setups: Sequence[str]
    noise_um: dict[str, float]
    angle_urad: float
    chain: str

    @property
    def diagonals(self) -> list[str]:
        """Return the setups with a plane mirror."""
        return [setup for setup in self.setups if not setup.startswith("linear")]

    @property
    def counts(self) -> tuple[int, int, int]:
        """Return how many unknowns the displacements, the angles and the mirrors have."""
        turning = len(ROTATIONS) * (WAVES + 1) if self.angle_urad else 0
        return len(DISPLACEMENTS) * self.box.increments, turning, 2 * len(self.diagonals)

    def machine(self, unknowns: Array) -> Machine:
        """Return the machine that a vector of unknowns stands for."""
        shown, turning, _ = self.counts
        low, size, n = self.box.origin_mm, self.box.size_mm, self.box.increments
        functions: dict[str, Table | Smooth] = {}
        for place, name in enumerate(DISPLACEMENTS):
            axis = AXES.index(name[2])
            at = low[axis] + size[axis] * np.arange(n + 1) / n
            value = np.concatenate([[0.0], unknowns[place * n : (place + 1) * n]])
            functions[name] = Table(tuple(at.tolist()), tuple(value.tolist()))
        for place, name in enumerate(ROTATIONS if turning else ()):
            axis = AXES.index(name[2])
            own = unknowns[shown + place * (WAVES + 1) : shown + (place + 1) * (WAVES + 1)]
            functions[name] = Smooth(
                low[axis], size[axis], tuple(own[1:].tolist()), float(own[0]) / size[axis]
            )
        return Machine(
            errors=ErrorSet(low_mm=low, size_mm=size, functions=functions), chain=self.chain
        )

    def readings_um(self, unknowns: Array) -> Array:
        """Return what every pass reads, each relative to its own first stop, in um."""
        machine, leaning = (
            self.machine(unknowns),
            unknowns[sum(self.counts[:2]) :].reshape(-1, 2),
        )
        parts = []
        for setup in self.setups:
            lean = (
                leaning[self.diagonals.index(setup)] * 0.1
                if setup in self.diagonals
                else np.zeros(2)
            )
            how = Alignment(mirror_mrad=(float(lean[0]), float(lean[1])))
            parts.append(
                1e3 * simulate_pass(machine, self.box, setup, 1, alignment=how).reading_mm
            )
        return np.concatenate(parts)

    @cached_property
    def normal(self) -> tuple[Array, Array, Array]:
        """Return derivatives (readings, unknowns + zeros), weights of the readings and of the
        unknowns."""
        count = sum(self.counts)
        start = self.readings_um(np.zeros(count))
        slopes = [(self.readings_um(_SMALL * one) - start) / _SMALL for one in np.eye(count)]
        zeros, weight = [], []
        stops = [
            len(simulate_pass(self.machine(np.zeros(count)), self.box, setup, 1).reading_mm)
            for setup in self.setups
        ]
        for place, setup in enumerate(self.setups):
            zeros.append(
                np.concatenate(
                    [np.full(many, float(other == place)) for other, many in enumerate(stops)]
                )
            )
            weight.append(
                np.full(
                    stops[place],
                    self.noise_um["linear" if setup.startswith("linear") else "diagonal"]
                    ** -2,
                )
            )
        usual = np.concatenate(
            [
                np.full(self.counts[0], _FREE),
                self.usual_urad(),
                np.full(self.counts[2], _FREE),
                np.full(len(zeros), _FREE),
            ]
        )
        return np.column_stack([*slopes, *zeros]), np.concatenate(weight), usual**-2.0

    def usual_urad(self) -> Array:
        """Return the root mean squares of slope and waves over drawn functions of this class."""
        if not self.angle_urad:
            return np.zeros(0)
        rng = np.random.default_rng(99)
        drawn = np.array(
            [smooth(rng, 0.0, 1.0, self.angle_urad / 2.0).amplitudes for _ in range(2000)]
        )
        own = np.concatenate(
            [[self.angle_urad / np.sqrt(12.0)], np.sqrt(np.mean(drawn**2, axis=0))]
        )
        return np.tile(own, len(ROTATIONS))

    def solve(self, reading_um: Array) -> Machine:
        """Return the machine that explains readings (each pass relative to its first stop) best."""
        slopes, weight, prior = self.normal
        matrix = slopes.T @ (weight[:, None] * slopes) + np.diag(prior)
        count = sum(self.counts)
        unknowns = np.zeros(len(prior))
        for _ in range(STEPS):
            left = (
                reading_um
                - self.readings_um(unknowns[:count])
                - slopes[:, count:] @ unknowns[count:]
            )
            unknowns = unknowns + np.linalg.solve(
                matrix, slopes.T @ (weight * left) - prior * unknowns
            )
        return self.machine(unknowns[:count])


def unmoved_um(points_mm: Array, error_um: Array) -> Array:
    """Return errors (N, 3) less the shift and rotation that fit them best."""
    lever = points_mm - points_mm.mean(axis=0)
    turns = np.stack([np.cross(axis, lever) for axis in np.eye(3)], axis=-1)
    motions = np.concatenate(
        [np.broadcast_to(np.eye(3), turns.shape), turns], axis=2
    ).reshape(-1, 6)
    flat = error_um.reshape(-1)
    rest: Array = flat - motions @ np.linalg.lstsq(motions, flat, rcond=None)[0]
    return rest.reshape(-1, 3)


def left_um(points_mm: Array, error_um: Array) -> float:
    """Return the root mean square length of errors (N, 3) less the shift and rotation that fit them
    best."""
    return float(np.sqrt(np.sum(unmoved_um(points_mm, error_um) ** 2) / len(points_mm)))
