"""What a result says about the whole volume: its posterior, the budget by sources, and what is to be expected before and after tables."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector, anywhere_mm
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.families import hidden_factors, normal_points
from stepdiag.solver.methods.angular import rms
from stepdiag.solver.model.assumptions import Assumptions
from stepdiag.solver.model.effects import TURNING
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.planning.foresight import CURVED
from stepdiag.solver.result.field import Smoothed, error_field_um, evenly
from stepdiag.solver.result.interval import Predicted
from stepdiag.solver.result.members import Budget, Drawn, MonteCarlo
from stepdiag.solver.result.posterior import Posterior
from stepdiag.solver.result.prediction import BETWEEN_SHARE, predicted_with_u
from stepdiag.solver.result.result import DISPLACEMENTS, POSITIONING, Function, Result
from stepdiag.solver.uncertainty.machine import (
    Machine,
    covariance,
    free_fields_um,
    machine_of,
    over_volume,
    posterior_of,
    separated,
    usual_rows,
    with_usual,
)
from stepdiag.solver.uncertainty.monte_carlo import monte_carlo
from stepdiag.solver.uncertainty.spread import Spread

HEAD_URAD = 1.0
"""What a 4-DOF head leaves of an angular function."""
SHORTEST = 0.5
"""What is known of the logarithm of an arch where the waves are hardly longer than two increments: drawn functions of five half waves on
five increments differ from what their values say by a factor of 1.3 on average."""
HARMFUL = 0.42
"""Where a function leaves the curve through its values by more than this share of itself, they say little of what is between them: more
than three and a half waves on ten increments."""
LEAST_VALUES = 8
"""Of fewer values the fourth differences are too few to tell waves from bends: five increments would nearly always be called coarse."""
FINEST_MM = 1e-3
"""Positions closer than this to a node are its own."""
_MOST_OF_SHOWN = 1.5
"""Of a wave that a finer run shows of one function the others may have anything from nothing to so many times as much, each as likely."""
_SURE = 2.0
"""What values say of what lies between them holds within this factor: only what is more was not to be expected."""
FEW_VALUES = 6
"""Of a function with so few values the waves are not separated from their bends: half of what is known (in logarithms) is what is usual."""
_OF_FEW = {3: 3.5, 4: 3.2, 5: 1.3, 6: 1.25}
"""Drawn functions of five half waves leave the curve through so few values by so much more than these say: their waves are no longer than
two increments."""
_AT_ENDS = 4.3
"""The spline knows waves less well in its two cells at either end: by 1.34 and 0.59 of what a parabola through three values leaves
(computed for waves of 2.2 to 5 increments); their squares count for four cells of all."""
_SEEN, _ALIASED = 0.6, 0.45
"""Cosines of half the turn from value to value: waves down to 3.4 increments look as they are; what looks like less than 2.85 may be a wave
shorter than two increments, which the spline knows nothing of."""
_UNSEEN = 1.2
"""Of such waves functions leave the curve by so much more than a parabola through three values does: drawn functions are less sure at
their ends."""
_BENT, _BENT_TWICE = 6.0, 70.0
"""Variances of the second and fourth difference of independent values over theirs."""


def with_the_usual(found: Adjustment, spread: Spread, quantities: Quantities, known: Mapping[str, bool]) -> Spread:
    """Return the covariances with what is usual for what is not identified; the same where all of it is."""
    rows, u = usual_rows(quantities, known, found.assumed)
    return replace(spread, fit=with_usual(found.fit, found.design, rows, u)) if len(rows) else spread


def make_posterior(
    found: Adjustment, spread: Spread, wider: Spread, quantities: Quantities, known: Mapping[str, bool], errors: Mapping[str, Function]
) -> Posterior:
    """Return how the machine may differ from what is reported; what is not identified counts with what is usual.

    ``wider`` are the covariances with that (`with_the_usual`): they say where the machine is to be expected.
    """
    first = found.first_cause("angles") if found.shapes.names else 0
    machine = machine_of(found.design, found.shapes, first, len(spread.fit.size))
    seen, unmeasured, offset = machine, np.zeros((len(machine.names),) * 2), np.zeros(len(machine.names))
    rows, u = usual_rows(quantities, known, found.assumed)
    if len(rows):
        seen, unmeasured = separated(machine, spread.fit.inverse, rows, u)
        offset = _offset(machine, wider, spread, errors, known)
    posterior = posterior_of(spread, seen, found.layout.volume, found.design.chain, offset, "angles", unmeasured)
    return replace(posterior, between_um=between_um(errors, found.assumed))


def _offset(machine: Machine, wider: Spread, spread: Spread, errors: Mapping[str, Function], known: Mapping[str, bool]) -> Vector:
    """Return where the machine is to be expected beside what is reported: nothing but what is not identified is left out there.

    Of a positioning function whose slope is not identified the rest is reported all the same.
    """
    expected = machine.combination.times(wider.fit.unknowns) + machine.on_causes @ wider.fit.amount
    whole = np.array([known.get(name, True) and (name not in POSITIONING or known[name[-1]]) for name in machine.names])
    seen = whole & spread.fit.inverse.sees(machine.combination)
    reported = np.array([_value_at(errors.get(name), node) for name, node in zip(machine.names, machine.node, strict=True)])
    found: Vector = np.where(seen, 0.0, expected - reported)
    return found


def _value_at(function: Function | None, node: int) -> float:
    return 0.0 if function is None or function.value is None else float(function.value[node])


def between_um(errors: Mapping[str, Function], assumed: Assumptions) -> dict[str, Vector]:
    """Return equally likely sizes of what each displacement function may do in the middle between two targets beside the straight line.

    How its values bend from target to target beyond their noise says it within a factor. Waves that leave no trace at the targets are
    looked for in the positioning functions (screw, scale): no reading tells how large they are, or whether they are there at all. Where a
    finer run shows such waves of one function, the others may have them as well.
    """
    factor, found, shown = hidden_factors(), {}, shown_finer_um(errors)
    likely, share = normal_points(len(factor)), _MOST_OF_SHOWN * (np.arange(len(factor)) + 0.5) / len(factor)
    for name in DISPLACEMENTS:
        function = errors[name]
        # of a function that nobody measured values are drawn that differ each by itself: they wave more than any that is smooth
        arch, within, value = 0.0, 0.0, _evenly(function)
        if len(value) > 2:
            arch, within = arch_um(value, _noise_um(function))
            if len(value) <= FEW_VALUES:
                usual = assumed.shape_um * min(CURVED / (len(value) - 1) ** 3, 1.0) / np.sqrt(BETWEEN_SHARE)
                arch, within = float(np.sqrt(_OF_FEW[len(value)] * arch * usual)), SHORTEST
        hidden = np.hypot(assumed.between_um * float(name in POSITIONING) * factor, shown[name] * share)
        found[name] = np.hypot(arch * np.exp(within * likely), np.roll(hidden, len(factor) // 2))
    return found


def shown_finer_um(errors: Mapping[str, Function]) -> dict[str, float]:
    """Return for each displacement function how large waves between its targets may be of which its values show nothing: those that finer
    runs show of the positioning function of its axis, or, where that was not driven finer, of the others' axes.

    A screw's pitch moves the carriage sideways too. How far it does nobody measured, so that these are usual sizes and no more.
    """
    seen = {}
    for name in POSITIONING:
        nodes_mm = next(errors[other].position_mm for other in DISPLACEMENTS if other[2] == name[2] and other != name)
        if (beside_um := _beside_its_values_um(errors[name], nodes_mm)) is not None:
            seen[name] = beside_um
    usual = rms(np.array([*seen.values()])) if seen else 0.0
    return {name: 0.0 if name in seen else seen.get(f"E{name[2]}{name[2]}", usual) for name in DISPLACEMENTS}


def _beside_its_values_um(function: Function, nodes_mm: Vector) -> float | None:
    """Return by how much a function, in the middle between two nodes (rms), leaves the smooth curve through its values at the nodes alone,
    beside what these and their noise let expect; None where nothing was measured between them."""
    at_mm, value = function.position_mm, function.value
    off = np.min(np.abs(at_mm[:, None] - nodes_mm), axis=1) > FINEST_MM
    if value is None or not np.any(off) or len(nodes_mm) < 3:
        return None
    at_nodes, noise_um = np.interp(nodes_mm, at_mm, value), _noise_um(function)
    left_um = value[off] - Smoothed(nodes_mm, at_nodes[None, :]).at(at_mm[off])[0]
    low = np.clip(np.searchsorted(nodes_mm, at_mm[off], side="right") - 1, 0, len(nodes_mm) - 2)
    share = (at_mm[off] - nodes_mm[low]) / (nodes_mm[low + 1] - nodes_mm[low])
    height = float(np.sum((4.0 * share * (1.0 - share)) ** 2))
    expected, _ = arch_um(at_nodes, noise_um)
    if len(at_nodes) <= FEW_VALUES:
        expected = max(_OF_FEW[len(at_nodes)] * expected, _shape_um(value) * CURVED / (len(at_nodes) - 1) ** 3 / np.sqrt(BETWEEN_SHARE))
    square_um2 = float(np.sum(left_um**2) - 2.0 * noise_um**2 * len(left_um)) / height
    return float(np.sqrt(max(square_um2 - (_SURE * expected) ** 2, 0.0)))


def _noise_um(function: Function) -> float:
    return 0.0 if function.u_readings is None else rms(function.u_readings)


def coarse_functions(errors: Mapping[str, Function]) -> list[str]:
    """Return the functions whose waves are hardly longer than two increments: between the targets nobody knows them."""
    names = []
    for name in DISPLACEMENTS:
        value = _evenly(errors[name])
        if len(value) > LEAST_VALUES:
            arch, _ = arch_um(value, _noise_um(errors[name]))
            if arch > HARMFUL * _shape_um(value):
                names.append(name)
    return names


def hiding_functions(errors: Mapping[str, Function]) -> dict[str, float]:
    """Return the functions that may have waves between their targets which could undo a table, and their size as finer runs show it of
    others, in um."""
    shown = shown_finer_um(errors)
    return {name: shown[name] for name in DISPLACEMENTS if shown[name] > HARMFUL * _shape_um(_evenly(errors[name])) > 0.0}


def _shape_um(value: Vector) -> float:
    return rms(value - np.linspace(value[0], value[-1], len(value))) if len(value) > 2 else 0.0


def coarse_findings(errors: Mapping[str, Function]) -> list[Finding]:
    """Return the findings on `coarse_functions` and `hiding_functions`."""
    found = []
    if names := coarse_functions(errors):
        found.append(message("increments-coarse", names=names))
    if hiding := hiding_functions(errors):
        found.append(message("increments-coarse.hidden", names=list(hiding), waves_um=max(hiding.values())))
    return [finding("warning", words) for words in found]


def _evenly(function: Function) -> Vector:
    """Return the values at equally distant positions, as far apart as the function's are at most; none of a function without values.

    Only there do bends say how short waves are, and where positions lie closer in places it is no better known everywhere.
    """
    at = function.position_mm
    if function.value is None or len(at) < 2:
        return np.zeros(0)
    return np.interp(evenly(at), at, function.value)


def arch_um(value: Vector, noise_um: float) -> tuple[float, float]:
    """Return by how much a function leaves the smooth curve in the middle between two of its values (rms), from how these bend, and the
    standard deviation of the logarithm of that.

    A wave that turns by w from value to value has second differences 4 sin^2(w/2), fourth ones their square: their ratio tells w. With
    c = cos(w/2) it leaves the spline of the predictions (`solver.result.field.Smoothed`) by (1 - c)^2 (2 - c) / (2 + 4 c^2), a parabola
    through three values by (1 - c)^2 (1 + c/2), which is the measure of the ends and of waves that may be shorter than they look, all
    times its size.
    Waves of nearly two increments look longer than they are.
    """
    bent = np.sqrt(max(rms(np.diff(value, n=2)) ** 2 - _BENT * noise_um**2, 0.0))
    if bent == 0.0 or len(value) < 5:
        return float(bent) / 8.0, SHORTEST
    twice = np.sqrt(max(rms(np.diff(value, n=4)) ** 2 - _BENT_TWICE * noise_um**2, 0.0))
    half = np.sqrt(1.0 - 0.25 * min(twice / bent, 4.0))  # cos(w/2)
    parabola = 1.0 + 0.5 * half
    spline = np.hypot((2.0 - half) / (2.0 + 4.0 * half**2), np.sqrt(_AT_ENDS / (len(value) - 1)) * parabola)
    short = np.clip((_SEEN - half) / (_SEEN - _ALIASED), 0.0, 1.0)
    left = (1.0 - short) * spline + short * max(_UNSEEN * parabola, spline)
    return float(bent * (1.0 - half) * left / (4.0 * (1.0 + half))), float(min(2.5 * (1.0 - half) ** 2, SHORTEST))


def budget(
    spread: Spread, quantities: Quantities, known: Mapping[str, bool], u: Vector, u_readings: Vector, texts: Mapping[str, str]
) -> Budget:
    """Return the budget (k = 1): what was assumed, the shares per function or number by source, and their combination.

    Shares are root mean squares over the nodes of a function. What is not identified has none: its numbers would be those of an arbitrary
    solution, and other ones on another processor.
    """
    moved = spread.moved(quantities.combination)
    shares = {"readings": u_readings, **spread.shares(moved)}
    groups = _known(quantities, known)
    return Budget(
        assumptions=dict(texts),
        shares={name: {source: rms(values[rows]) for source, values in shares.items()} for name, rows in groups.items()},
        combined={name: rms(u[rows]) for name, rows in groups.items()},
    )


def _known(quantities: Quantities, known: Mapping[str, bool]) -> dict[str, NDArray[np.int64]]:
    return {name: quantities.of(name) for name in quantities.groups if known.get(name, True)}


def drawn_surveys(spread: Spread, quantities: Quantities, known: Mapping[str, bool], u: Vector, trials: int) -> MonteCarlo:
    """Return per function (rms over its nodes) or number the standard deviation of drawn surveys, beside the one stated, and the shortest
    95 % interval of a number (JCGM 101)."""
    drawn = monte_carlo(spread, quantities.combination, trials=trials)
    report = {}
    for name, rows in _known(quantities, known).items():
        low, high = (float(end[rows[0]]) if len(rows) == 1 else None for end in (drawn.low, drawn.high))
        report[name] = Drawn(u=rms(drawn.u[rows]), u_stated=rms(u[rows]), low=low, high=high)
    return MonteCarlo(trials=trials, quantities=report)


def volume_report(result: Result, posterior: Posterior) -> tuple[Predicted, float]:
    """Return what is to be expected as the machine stands and after an ideal compensation, and the volumetric uncertainty (rms, k = 1)."""
    points = anywhere_mm(result.volume)
    return predicted_with_u(result, posterior, points, -error_field_um(result, points))


def left_with_head_um(found: Adjustment, wider: Spread, now_um: float) -> dict[str, float]:
    """Return the volumetric uncertainty as it is and with all angular functions known to `HEAD_URAD`.

    What is not identified counts with what is usual (`with_the_usual`), as in ``now_um``: alone it is that of an arbitrary solution.
    """
    if not found.shapes.names:
        return {"now": now_um, "with_head": now_um}
    turning = wider.causes_of(*TURNING)
    usual = float(np.mean(found.shapes.range_urad)) * found.sizes.factor[wider.group]
    factor = np.where(turning, 2.0 * HEAD_URAD / np.maximum(usual, 2.0 * HEAD_URAD), 1.0)
    # the readings hold the angles as they are: with small ones they would say that all other causes are larger
    sure = replace(found.sizes, sought=np.zeros_like(found.sizes.sought))
    quiet = replace(wider, fit=sized(wider.fit, factor), sizes=sure)
    machine = machine_of(found.design, found.shapes, found.first_cause("angles"), len(wider.group))
    fields = free_fields_um(machine, found.layout.volume, found.design.chain)
    with_head, without = (over_volume(covariance(one, machine), fields)[0] for one in (quiet, wider))
    return {"now": now_um, "with_head": float(np.sqrt(max(now_um**2 - max(without**2 - with_head**2, 0.0), 0.0)))}
