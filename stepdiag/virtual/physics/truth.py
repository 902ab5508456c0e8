"""The true errors of the machine in the form of a result: 21 errors with ISO 230-1 names and signs
(contract 1)."""

from dataclasses import dataclass

import numpy as np

from stepdiag.virtual.physics.error_functions import (
    AXES,
    DISPLACEMENTS,
    ROTATIONS,
    Array,
    ErrorSet,
    zero,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """The true errors of the machine, as a perfect survey would find them.

    ``position_mm``: by axis letter, ascending. ``errors``: by name in um or urad, zero at the first
    position; a straightness has its end-point line removed, a positioning error keeps its slope.
    ``squareness_urad`` contains the removed slopes; ``scale_um_m`` is the slope of the end-point
    line of each positioning function.
    """

    position_mm: dict[str, Array]
    errors: dict[str, Array]
    squareness_urad: dict[str, float]
    scale_um_m: dict[str, float]


def truth(errors: ErrorSet, increments: int) -> Truth:
    """Return the mean of the errors in both directions at ``increments`` + 1 nodes of each axis."""
    position_mm = {
        letter: errors.low_mm[axis] + np.linspace(0.0, errors.size_mm[axis], increments + 1)
        for axis, letter in enumerate(AXES)
    }
    values: dict[str, Array] = {}
    slope_um_m: dict[str, float] = {}
    for name in (*DISPLACEMENTS, *ROTATIONS):
        nodes = position_mm[name[2]]
        value = errors.functions.get(name, zero)(nodes)
        value = value - value[0]
        slope_um_m[name] = float(value[-1] / (nodes[-1] - nodes[0]) * 1e3)
        straightness = name in DISPLACEMENTS and name[1] != name[2]
        values[name] = (
            value - slope_um_m[name] * 1e-3 * (nodes - nodes[0]) if straightness else value
        )
    return Truth(
        position_mm=position_mm,
        errors=values,
        squareness_urad=_squareness(errors, slope_um_m),
        scale_um_m={letter: slope_um_m[f"E{letter}{letter}"] for letter in AXES},
    )


def _squareness(errors: ErrorSet, slope_um_m: dict[str, float]) -> dict[str, float]:
    """Return the angles between the end-point lines of the axes.

    The cosine between X = (1, EYX', EZX') and Y = (EXY', 1, EZY') is EYX' + EXY'; with Y = (-C0Y,
    1, 0) it is -C0Y. In the same way the cosine of Z and X is +B0Z and that of Z and Y is -A0Z.
    """
    given = errors.squareness_urad
    return {
        "C0Y": given.get("C0Y", 0.0) - slope_um_m["EXY"] - slope_um_m["EYX"],
        "B0Z": given.get("B0Z", 0.0) + slope_um_m["EXZ"] + slope_um_m["EZX"],
        "A0Z": given.get("A0Z", 0.0) - slope_um_m["EYZ"] - slope_um_m["EZY"],
    }
