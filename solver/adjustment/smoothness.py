"""The roughness of the machine's errors: a guideway bends smoothly and does not jump between
targets."""

import numpy as np

from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.monotone import falling_pools, pool_means
from stepdiag.solver.model.design import Columns
from stepdiag.solver.model.noise import LEAST_U_UM


def roughness(columns: Columns, unknowns: Vector, variance_um2: Vector) -> Vector:
    """Return twice the negative log-likelihood of the nine displacement functions, shape (k,) for
    ``unknowns`` (count, k).

    The amounts of a function's half waves are treated as normally distributed. The power of the
    half waves is estimated from the functions and does not rise with the wave number (isotonic
    maximum likelihood). A jump between targets is therefore unlikely: it adds the same power to
    short and long waves. ``variance_um2`` (count,) is the variance of each unknown by noise; it
    limits the power from below.
    """
    waves = columns.nodes - 1
    if waves < 2:
        return np.zeros(unknowns.shape[1])
    number = np.arange(1, columns.nodes)
    transform = np.sin(np.pi * np.outer(number, number) / columns.nodes) * 2.0 / columns.nodes
    power = np.zeros((waves, unknowns.shape[1]))
    for axis in range(3):
        for component in range(3):
            values = unknowns[columns.of(0, axis, component)]
            shape = values[:-1] - values[-1] * (number / columns.nodes)[:, None]
            power += (transform @ shape) ** 2 / len(DISPLACEMENTS)
    shown = np.concatenate(
        [columns.of(0, axis, component)[:-1] for axis in range(3) for component in range(3)]
    )
    noise_um2 = 2.0 / columns.nodes * float(np.quantile(variance_um2[shown], 0.5))
    power = np.maximum(power, max(noise_um2, LEAST_U_UM**2))
    falling = np.column_stack([pool_means(each, falling_pools(each)) for each in power.T])
    likelihood: Vector = len(DISPLACEMENTS) * np.sum(
        np.log(falling) + power / falling, axis=0
    )
    return likelihood
