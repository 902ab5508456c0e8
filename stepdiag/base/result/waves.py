"""Waves of an error function that are too short for its targets: their possible size between the
targets."""

from collections.abc import Mapping

import numpy as np

from stepdiag.base.result.field import Smoothed, evenly
from stepdiag.base.result.prediction import BETWEEN_SHARE
from stepdiag.base.result.result import DISPLACEMENTS, POSITIONING, Function
from stepdiag.base.volume import Vector, rms

CURVED = 22.0
"""Difference between a function and the smooth curve through its values at n + 1 targets, divided
by shape / n^3 (both root mean squares over the travel). Computed from drawn functions: sums of five
half waves whose size decreases with their number."""
SHORTEST = 0.5
"""Standard deviation of the logarithm of an arch's height for waves of about two increments. Drawn
functions of five half waves on five increments differ on average by a factor of 1.3 from the size
predicted by their values."""
HARMFUL = 0.42
"""Largest share of a function that may be missing in the smooth curve through its values; more than
three and a half waves on ten increments exceed it."""
LEAST_VALUES = 8
"""Number of values above which the waves of a function can be separated from its bends. Fewer
values have too few fourth differences: five increments would nearly always be reported as too
coarse."""
FINEST_MM = 1e-3
"""Distance in mm below which a position counts as a node."""
_SURE = 2.0
"""Ratio of a wave between the values to its predicted size above which the wave is unexpected."""
FEW_VALUES = 6
"""Number of values up to which the waves of a function cannot be separated from its bends. The
logarithm of the size is then the mean of the measured and the usual logarithm."""
OF_FEW = {3: 3.5, 4: 3.2, 5: 1.3, 6: 1.25}
"""Factor on the difference from the smooth curve, by the number of values. A function with few
values shows too small a difference, because its waves are not longer than two increments. The
factors were computed from drawn functions of five half waves."""
_AT_ENDS = 4.3
"""Sum over the four end cells of the squared difference between waves and their spline, divided by
the squared difference between the waves and a parabola through three values. The ratio of these two
differences is 1.34 in the first cell from either end and 0.59 in the second cell (computed for
waves of 2.2 to 5 increments)."""
_SEEN, _ALIASED = 0.6, 0.45
"""Cosines of half the phase step of a wave from value to value. Waves down to 3.4 increments appear
with their true length. A wave that appears shorter than 2.85 increments can be shorter than two
increments, which a spline does not show."""
_UNSEEN = 1.2
"""Factor on the difference from a parabola through three values, for functions with waves shorter
than two increments: drawn functions differ more from the smooth curve than from this parabola, most
of all at their ends."""
_BENT, _BENT_TWICE = 6.0, 70.0
"""Variances of the second and the fourth difference of independent values, divided by the variance
of the values."""


def shown_finer_um(errors: Mapping[str, Function]) -> dict[str, float]:
    """Return the size of hidden waves between the targets of each displacement function. The size
    is that shown by a finer run of the positioning function of the same axis. Without this run, the
    finer runs of the other axes are used.

    The pitch of a screw also moves the carriage sideways. No run measures this sideways motion, so
    the returned sizes are usual sizes.
    """
    seen = {}
    for name in POSITIONING:
        nodes_mm = next(
            errors[other].position_mm
            for other in DISPLACEMENTS
            if other[2] == name[2] and other != name
        )
        if (beside_um := _beside_its_values_um(errors[name], nodes_mm)) is not None:
            seen[name] = beside_um
    usual = rms(np.array([*seen.values()])) if seen else 0.0
    return {
        name: 0.0 if name in seen else seen.get(f"E{name[2]}{name[2]}", usual)
        for name in DISPLACEMENTS
    }


def _beside_its_values_um(function: Function, nodes_mm: Vector) -> float | None:
    """Return the rms difference, in the middle between two nodes, between a function and the smooth
    curve through its values at the nodes. The difference that the values and their noise already
    explain is subtracted. Return None without measurements between the nodes."""
    at_mm, value = function.position_mm, function.value
    off = np.min(np.abs(at_mm[:, None] - nodes_mm), axis=1) > FINEST_MM
    if value is None or not np.any(off) or len(nodes_mm) < 3:
        return None
    at_nodes, noise_um = np.interp(nodes_mm, at_mm, value), noise_um_of(function)
    left_um = value[off] - Smoothed(nodes_mm, at_nodes[None, :]).at(at_mm[off])[0]
    low = np.clip(
        np.searchsorted(nodes_mm, at_mm[off], side="right") - 1, 0, len(nodes_mm) - 2
    )
    share = (at_mm[off] - nodes_mm[low]) / (nodes_mm[low + 1] - nodes_mm[low])
    height = float(np.sum((4.0 * share * (1.0 - share)) ** 2))
    expected, _ = arch_um(at_nodes, noise_um)
    if len(at_nodes) <= FEW_VALUES:
        expected = max(
            OF_FEW[len(at_nodes)] * expected,
            _shape_um(value) * CURVED / (len(at_nodes) - 1) ** 3 / np.sqrt(BETWEEN_SHARE),
        )
    square_um2 = float(np.sum(left_um**2) - 2.0 * noise_um**2 * len(left_um)) / height
    return float(np.sqrt(max(square_um2 - (_SURE * expected) ** 2, 0.0)))


def noise_um_of(function: Function) -> float:
    return 0.0 if function.u_readings is None else rms(function.u_readings)


def coarse_functions(errors: Mapping[str, Function]) -> list[str]:
    """Return the functions whose waves are hardly longer than two increments: their values between
    the targets are unknown."""
    names = []
    for name in DISPLACEMENTS:
        value = evenly_spaced(errors[name])
        if len(value) > LEAST_VALUES:
            arch, _ = arch_um(value, noise_um_of(errors[name]))
            if arch > HARMFUL * _shape_um(value):
                names.append(name)
    return names


def hiding_functions(errors: Mapping[str, Function]) -> dict[str, float]:
    """Return the size in um of the possible waves between the targets (`shown_finer_um`), for each
    function whose waves can be larger than the gain of a table."""
    shown = shown_finer_um(errors)
    return {
        name: shown[name]
        for name in DISPLACEMENTS
        if shown[name] > HARMFUL * _shape_um(evenly_spaced(errors[name])) > 0.0
    }


def _shape_um(value: Vector) -> float:
    return (
        rms(value - np.linspace(value[0], value[-1], len(value))) if len(value) > 2 else 0.0
    )


def evenly_spaced(function: Function) -> Vector:
    """Return the values of a function at equally spaced positions, at most as far apart as its own
    positions; an empty array for a function without values."""
    at = function.position_mm
    if function.value is None or len(at) < 2:
        return np.zeros(0)
    return np.interp(evenly(at), at, function.value)


def arch_um(value: Vector, noise_um: float) -> tuple[float, float]:
    """Return the rms difference between a function and the smooth curve in the middle between two
    of its values, computed from the bends of the values, and the standard deviation of the
    logarithm of this difference.

    A wave with the phase step w from value to value has second differences of 4 sin^2(w/2) and
    fourth differences of the square of this factor: their ratio gives w. With c = cos(w/2), the
    wave differs from the spline of the predictions (`solver.result.field.Smoothed`) by (1 - c)^2 (2
    - c) / (2 + 4 c^2), and from a parabola through three values by (1 - c)^2 (1 + c/2), both times
    its size. The parabola is used at the ends, and for waves that can be shorter than they appear.
    """
    bent = np.sqrt(max(rms(np.diff(value, n=2)) ** 2 - _BENT * noise_um**2, 0.0))
    if bent == 0.0 or len(value) < 5:
        return float(bent) / 8.0, SHORTEST
    twice = np.sqrt(max(rms(np.diff(value, n=4)) ** 2 - _BENT_TWICE * noise_um**2, 0.0))
    half = np.sqrt(1.0 - 0.25 * min(twice / bent, 4.0))  # cos(w/2)
    parabola = 1.0 + 0.5 * half
    spline = np.hypot(
        (2.0 - half) / (2.0 + 4.0 * half**2), np.sqrt(_AT_ENDS / (len(value) - 1)) * parabola
    )
    short = np.clip((_SEEN - half) / (_SEEN - _ALIASED), 0.0, 1.0)
    left = (1.0 - short) * spline + short * max(_UNSEEN * parabola, spline)
    return float(bent * (1.0 - half) * left / (4.0 * (1.0 + half))), float(
        min(2.5 * (1.0 - half) ** 2, SHORTEST)
    )
