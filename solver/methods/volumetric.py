"""The results for the whole volume: the posterior of the machine, the budget by sources, and the
expected errors before and after compensation."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Words, message
from stepdiag.base.names import PRODUCTS
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.interval import Predicted
from stepdiag.base.result.members import (
    BETWEEN_TARGETS,
    NOT_MEASURED,
    READINGS,
    VOLUME,
    Budget,
    Drawn,
    MonteCarlo,
)
from stepdiag.base.result.posterior import Posterior
from stepdiag.base.result.prediction import BETWEEN_SHARE, predicted_with_u
from stepdiag.base.result.result import DISPLACEMENTS, POSITIONING, Function, Result
from stepdiag.base.result.waves import (
    CURVED,
    FEW_VALUES,
    OF_FEW,
    SHORTEST,
    arch_um,
    coarse_functions,
    evenly_spaced,
    hiding_functions,
    noise_um_of,
    shown_finer_um,
)
from stepdiag.base.volume import Vector, anywhere_mm, rms
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.families import hidden_factors, normal_points
from stepdiag.solver.model.effects import TURNING
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.uncertainty.machine import (
    Machine,
    free_fields_um,
    machine_of,
    posterior_of,
    separated,
    usual_rows,
    with_usual,
)
from stepdiag.solver.uncertainty.monte_carlo import monte_carlo
from stepdiag.solver.uncertainty.spread import Spread

HEAD_URAD = 1.0
"""Range of the remaining error of an angular function after measurement by a 4-DOF head, in
urad."""
_MOST_OF_SHOWN = 1.5
"""Largest ratio of the waves in any function to the wave that a finer run showed in one
function; all ratios from 0 to this value are equally likely."""


Machines = tuple[Machine, Machine, Vector]
"""The whole machine, the part that the readings determine, and the covariance of the part that they
do not determine."""


def with_the_usual(
    found: Adjustment, spread: Spread, quantities: Quantities, known: Mapping[str, bool]
) -> Spread:
    """Return the covariances with the usual sizes for quantities that are not identified."""
    rows, u = usual_rows(quantities, known, found.assumed)
    return (
        replace(spread, fit=with_usual(spread.fit, found.design, rows, u))
        if len(rows)
        else spread
    )


def make_posterior(
    found: Adjustment,
    spread: Spread,
    wider: Spread,
    machines: Machines,
    known: Mapping[str, bool],
    errors: Mapping[str, Function],
) -> Posterior:
    """Return the distribution of the differences between the machine and the reported errors.

    ``wider`` are the covariances of `with_the_usual`, from which the expected errors of the machine
    are computed; ``machines`` is the result of `as_known`.
    """
    machine, seen, unmeasured = machines
    offset = _offset(machine, wider, spread, errors, known)
    posterior = posterior_of(
        spread, seen, found.layout.volume, found.design.chain, offset, "angles", unmeasured
    )
    return replace(posterior, between_um=between_um(errors, found.assumed))


def as_known(
    found: Adjustment, spread: Spread, quantities: Quantities, known: Mapping[str, bool]
) -> Machines:
    """Return the whole machine, the part that the readings determine, and the covariance of the
    part that they do not determine."""
    first = found.first_cause("angles") if found.shapes.names else 0
    machine = machine_of(
        found.design, found.shapes, first, len(spread.fit.size), found.products
    )
    rows, u = usual_rows(quantities, known, found.assumed)
    if not len(rows):
        return machine, machine, np.zeros((len(machine.names),) * 2)
    return machine, *separated(machine, spread.fit.inverse, rows, u)


def volume_shares_um(
    found: Adjustment,
    spread: Spread,
    machines: Machines,
    posterior: Posterior,
    u_um: float,
) -> dict[str, float]:
    """Return the root mean square length of the error vector over the volume for each source of
    uncertainty (k = 1). ``u_um`` is the combined value. The share of unmeasured errors is the root
    of ``u_um``^2 minus the squares of all other shares."""
    _, seen, unmeasured = machines
    fields = free_fields_um(seen, found.layout.volume, found.design.chain)
    # a QR decomposition reduces the rows: the square sum of ``over`` times the values is the mean
    # square of the error vector over the points
    over = np.sqrt(3.0 / fields.shape[1]) * np.linalg.qr(fields.T, mode="r")
    alone = over @ seen.combination.dense()
    moved = over @ spread.moved(seen.combination, seen.on_causes)
    by_noise = float(
        np.sum(alone.T * spread.fit.inverse.solve(alone.T))
        + np.sum(spread.variance_by_readings(moved))
    )
    shares = {READINGS: float(np.sqrt(max(by_noise, 0.0)))}
    shares |= {
        name: float(np.linalg.norm(each)) for name, each in spread.shares(moved).items()
    }
    shares[BETWEEN_TARGETS] = float(
        np.sqrt(
            BETWEEN_SHARE
            * sum(float(np.mean(sizes**2)) for sizes in posterior.between_um.values())
        )
    )
    if np.any(unmeasured):
        shares[NOT_MEASURED] = float(
            np.sqrt(max(u_um**2 - sum(each**2 for each in shares.values()), 0.0))
        )
    return shares


def _offset(
    machine: Machine,
    wider: Spread,
    spread: Spread,
    errors: Mapping[str, Function],
    known: Mapping[str, bool],
) -> Vector:
    """Return the expected difference between the machine and the report, which omits quantities
    that are not identified. If the slope of a positioning function is not identified, the report
    contains the function without its end-point line."""
    expected = (
        machine.combination.times(wider.fit.unknowns) + machine.on_causes @ wider.fit.amount
    )
    tabled = [
        name not in PRODUCTS
        and known.get(name, True)
        and (name not in POSITIONING or known[name[-1]])
        for name in machine.names
    ]
    whole = np.array(tabled)
    seen = whole & spread.fit.inverse.sees(machine.combination)
    reported = np.array(
        [
            _value_at(errors.get(name), node)
            for name, node in zip(machine.names, machine.node, strict=True)
        ]
    )
    found: Vector = np.where(seen, 0.0, expected - reported)
    return found


def _value_at(function: Function | None, node: int) -> float:
    return 0.0 if function is None or function.value is None else float(function.value[node])


def between_um(errors: Mapping[str, Function], assumed: Assumptions) -> dict[str, Vector]:
    """Return, for each displacement function, equally likely sizes of its deviation between two
    targets.

    The deviation is the distance, halfway between two targets, of the function from the straight
    line through its values at both targets.

    The size is estimated from the bends of the function at the targets, minus the noise. Waves that
    are zero at the targets are assumed for positioning functions (ball screw, scale), because no
    reading shows these waves. If a finer run shows such waves in one function, they are assumed for
    all functions.
    """
    factor, found, shown = hidden_factors(), {}, shown_finer_um(errors)
    likely, share = (
        normal_points(len(factor)),
        _MOST_OF_SHOWN * (np.arange(len(factor)) + 0.5) / len(factor),
    )
    for name in DISPLACEMENTS:
        function = errors[name]
        # the errors of an unmeasured function are drawn independently at each node, so they are
        # rougher than a smooth function
        arch, within, value = 0.0, 0.0, evenly_spaced(function)
        if len(value) > 2:
            arch, within = arch_um(value, noise_um_of(function))
            if len(value) <= FEW_VALUES:
                usual = (
                    assumed.shape_um
                    * min(CURVED / (len(value) - 1) ** 3, 1.0)
                    / np.sqrt(BETWEEN_SHARE)
                )
                arch, within = float(np.sqrt(OF_FEW[len(value)] * arch * usual)), SHORTEST
        hidden = np.hypot(
            assumed.between_um * float(name in POSITIONING) * factor, shown[name] * share
        )
        found[name] = np.hypot(
            arch * np.exp(within * likely), np.roll(hidden, len(factor) // 2)
        )
    return found


def coarse_findings(errors: Mapping[str, Function]) -> list[Finding]:
    """Return the findings about functions whose increments are too coarse."""
    found = []
    if names := coarse_functions(errors):
        found.append(message("increments-coarse", names=names))
    if hiding := hiding_functions(errors):
        found.append(
            message(
                "increments-coarse.hidden", names=list(hiding), waves_um=max(hiding.values())
            )
        )
    return [finding("warning", words) for words in found]


def budget(
    spread: Spread,
    quantities: Quantities,
    known: Mapping[str, bool],
    u: Vector,
    u_readings: Vector,
    texts: Mapping[str, Words],
    volume: Mapping[str, float],
) -> Budget:
    """Return the budget (k = 1): the assumptions, the share of each source in the uncertainty of
    each quantity, and the combined uncertainty.

    The shares of a function are root mean squares over its nodes. Quantities that are not
    identified are omitted, because their values would depend on the processor.
    """
    moved = spread.moved(quantities.combination)
    shares = {READINGS: u_readings, **spread.shares(moved)}
    groups = _known(quantities, known)
    whole = {VOLUME: dict(volume)} if volume else {}
    return Budget(
        assumptions=dict(texts),
        shares={
            **whole,
            **{
                name: {source: rms(values[rows]) for source, values in shares.items()}
                for name, rows in groups.items()
            },
        },
        combined={
            **{
                name: float(np.linalg.norm(list(each.values())))
                for name, each in whole.items()
            },
            **{name: rms(u[rows]) for name, rows in groups.items()},
        },
    )


def _known(quantities: Quantities, known: Mapping[str, bool]) -> dict[str, NDArray[np.int64]]:
    return {name: quantities.of(name) for name in quantities.groups if known.get(name, True)}


def drawn_surveys(
    spread: Spread, quantities: Quantities, known: Mapping[str, bool], u: Vector, trials: int
) -> MonteCarlo:
    """Return, for each quantity, its standard deviation in simulated surveys (JCGM 101) and its
    stated standard uncertainty, rms over the nodes of a function. For a single number, the result
    also contains the shortest 95 % interval."""
    drawn = monte_carlo(spread, quantities.combination, trials=trials)
    report = {}
    for name, rows in _known(quantities, known).items():
        low, high = (
            float(end[rows[0]]) if len(rows) == 1 else None for end in (drawn.low, drawn.high)
        )
        report[name] = Drawn(u=rms(drawn.u[rows]), u_stated=rms(u[rows]), low=low, high=high)
    return MonteCarlo(trials=trials, quantities=report)


def volume_report(result: Result, posterior: Posterior) -> tuple[Predicted, float]:
    """Return the expected errors of the machine before and after an ideal compensation, and the
    volumetric uncertainty (rms, k = 1)."""
    points = anywhere_mm(result.volume)
    return predicted_with_u(result, posterior, points, -error_field_um(result, points))


def left_with_head_um(found: Adjustment, wider: Spread, now_um: float) -> dict[str, float]:
    """Return the volumetric uncertainty in um as measured (``now``), and for a head that
    measured all angular functions within `HEAD_URAD` (``with_head``)."""
    if not found.shapes.names:
        return {"now": now_um, "with_head": now_um}
    turning = wider.causes_of(*TURNING)
    usual = float(np.mean(found.shapes.range_urad)) * wider.sizes.factor[wider.group]
    factor = np.where(turning, 2.0 * HEAD_URAD / np.maximum(usual, 2.0 * HEAD_URAD), 1.0)
    # all other sizes are constant: with smaller angles, a new estimate would be
    # larger
    sure = replace(wider.sizes, sought=np.zeros_like(wider.sizes.sought))
    quiet = replace(wider, fit=sized(wider.fit, factor), sizes=sure)
    machine = machine_of(
        found.design, found.shapes, found.first_cause("angles"), len(wider.group)
    )
    fields = free_fields_um(machine, found.layout.volume, found.design.chain)
    moved = wider.moved(machine.combination, machine.on_causes)
    over = moved.T @ (fields @ fields.T) @ moved
    less = 3.0 * float(np.sum((wider.amount - quiet.amount) * over)) / fields.shape[1]
    return {
        "now": now_um,
        "with_head": float(np.sqrt(max(now_um**2 - max(less, 0.0), 0.0))),
    }
