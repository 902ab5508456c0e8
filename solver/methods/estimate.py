"""The estimator as a method of the solver: all readings of a survey in one adjustment, and what it identifies."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stepdiag.solver.adjustment.adjustment import Adjustment, adjust
from stepdiag.solver.adjustment.diagnostics import closure_report, inflation, setup_findings, setup_reports
from stepdiag.solver.findings import Finding
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.methods.contradictions import contradictions
from stepdiag.solver.methods.head_report import head_findings, head_report
from stepdiag.solver.methods.standard_figures import standards_findings, standards_report
from stepdiag.solver.model.angles import Angles, angle_at_nodes
from stepdiag.solver.model.design import Model
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.priors import UNKNOWN_ANGLE_URAD
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.model.reported import (
    POSITIONING,
    REVERSAL_PART,
    SCALE_SUM,
    backlash,
    identified,
    reported,
    reversal,
    shape,
    sloped,
    variance,
)
from stepdiag.solver.planning.identifiability import cheapest_runs
from stepdiag.solver.result.result import AXIS_LETTERS, DISPLACEMENTS, ROTATIONS, SQUARENESS, Function, Quantity, Result, Scale
from stepdiag.solver.uncertainty.propagation import adjusted_uncertainty
from stepdiag.solver.uncertainty.sources import Assumptions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """An adjustment and the values, standard uncertainties and identifiability of all that is reported."""

    adjustment: Adjustment
    quantities: Quantities
    value: Vector
    u: Vector
    known: dict[str, bool]

    @property
    def gain(self) -> Vector:
        """Return the linear operator (q, m): quantities = gain @ deviation_um. 200,000 Monte Carlo trials are one product with it."""
        fit = self.adjustment.fit
        spread = fit.inverse.solve(self.quantities.combination.dense().T)
        matrix: Vector = (fit.rows.times(spread) * fit.weight[:, None]).T
        return matrix[:, : len(self.adjustment.layout)]

    @property
    def covariance(self) -> Vector:
        """Return the covariance of all quantities from the readings' noise and the priors, shape (q, q)."""
        spread = self.adjustment.fit.inverse.solve(self.quantities.combination.dense().T)
        matrix: Vector = self.quantities.combination.times(spread) * inflation(self.adjustment) ** 2
        return matrix

    def number(self, name: str) -> tuple[float, float] | None:
        """Return value and standard uncertainty of a number, None where it is not identified."""
        row = self.quantities.of(name)[0]
        return (float(self.value[row]), float(self.u[row])) if self.known[name] else None

    def curve(self, name: str, nodes: int) -> tuple[Vector, Vector] | None:
        """Return value and standard uncertainty of a function at nodes 0 .. n, zero where it is zero by definition."""
        if not self.known[name]:
            return None
        value, u = np.zeros(nodes + 1), np.zeros(nodes + 1)
        rows = self.quantities.of(name)
        value[self.quantities.node[rows]], u[self.quantities.node[rows]] = self.value[rows], self.u[rows]
        return value, u


def estimate(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    estimate_angles: bool = False,
    straightness: Sequence[MeasuredStraightness] = (),
) -> Estimate:
    """Adjust a survey and evaluate everything that can be reported. Raises as `solver.adjustment.adjustment.adjust`."""
    adjustment = adjust(layout, chain, angles=angles, estimate_angles=estimate_angles, straightness=straightness)
    found = reported(adjustment.design)
    inverse = adjustment.fit.inverse
    return Estimate(
        adjustment=adjustment,
        quantities=found,
        value=found.combination.times(adjustment.fit.unknowns),
        u=np.sqrt(variance(found, inverse)) * inflation(adjustment),
        # of a single increment a function has only its ends: the shape between them is zero, and no combination stands for it
        known={**dict.fromkeys(DISPLACEMENTS, True), **identified(found, inverse)},
    )


def solve_estimate(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    estimate_angles: bool = False,
    straightness: Sequence[MeasuredStraightness] = (),
) -> Result:
    """Return the result of the estimator; what the readings do not identify is None and named in a finding with its remedy."""
    done = estimate(layout, chain, angles=angles, estimate_angles=estimate_angles, straightness=straightness)
    reports = setup_reports(done.adjustment)
    findings = (
        *layout.findings,
        *_missing(done),
        *done.adjustment.findings,
        *setup_findings(done.adjustment, reports),
        *contradictions(done.adjustment, chain, reports, Assumptions()),
        *standards_findings(layout),
    )
    of_head = head_report(done.adjustment, straightness)
    return Result(
        volume=layout.volume,
        chain=chain,
        method="estimate",
        errors=_errors(done),
        reversal=_reversal(done),
        squareness={name: Quantity(value=value, u=u) for name in SQUARENESS for value, u in (done.number(name) or (None, None),)},
        scale={letter: _scale(done.number(letter)) for letter in AXIS_LETTERS},
        setups=reports,
        findings=(*findings, *head_findings(of_head), *_assumptions(done)),
        extra={
            **_extra(done),
            **({"head_straightness": of_head} if of_head else {}),
            "budget": _budget(done),
            "standards": standards_report(layout),
        },
    )


def _budget(done: Estimate) -> dict[str, dict[str, object]]:
    """Return what else is uncertain beside the noise that ``u`` states, by source, under the usual assumptions."""
    return adjusted_uncertainty(done.adjustment, Assumptions()).report()


def _scale(number: tuple[float, float] | None) -> Scale:
    return Scale(value=None, u=None, identified=False) if number is None else Scale(value=number[0], u=number[1], identified=True)


def _errors(done: Estimate) -> dict[str, Function]:
    """Return the nine displacement functions and the angular functions that are known or estimated."""
    errors = {name: _function(done, name, sloped(name) if name in POSITIONING else None) for name in DISPLACEMENTS}
    for name in ROTATIONS:
        if name in done.adjustment.angles:
            errors[name] = _known_angle(done, name)
        elif done.adjustment.estimates_angles:
            estimated = _function(done, shape(name), name)
            errors[name] = replace(estimated, unit="urad")
    return errors


def _function(done: Estimate, name: str, with_slope: str | None) -> Function:
    """Return a function with its slope where that is identified, else its shape, else without values."""
    volume = done.adjustment.layout.volume
    full = done.curve(with_slope, volume.increments) if with_slope else None
    value, u = full or done.curve(name, volume.increments) or (None, None)
    return Function(
        position_mm=volume.nodes_mm(AXIS_LETTERS.index(name[-1])),
        value=value,
        u=u,
        unit="um",
        slope_identified=with_slope is None or full is not None,
    )


def _known_angle(done: Estimate, name: str) -> Function:
    """Return a given angular function, adjusted within its uncertainty where it has one."""
    volume = done.adjustment.layout.volume
    value, stated = (np.concatenate([[0.0], column]) for column in angle_at_nodes(done.adjustment.angles[name], name, volume))
    u: Vector | None = stated if np.all(np.isfinite(stated)) else None
    adjusted = done.curve(name, volume.increments) if u is not None else None
    if adjusted is not None:
        value, u = value + adjusted[0], adjusted[1]
    return Function(position_mm=volume.nodes_mm(AXIS_LETTERS.index(name[-1])), value=value, u=u, unit="urad")


def _reversal(done: Estimate) -> dict[str, Function]:
    """Return the reversal of every function: with its value at the low end where the data have it, else from zero there (u is zero too)."""
    if REVERSAL_PART not in done.adjustment.design.columns.parts:
        return {}
    whole = {name: done.known.get(backlash(name), False) for name in DISPLACEMENTS}
    functions = {name: _function(done, backlash(name) if whole[name] else reversal(name), None) for name in DISPLACEMENTS}
    return {name: function for name, function in functions.items() if function.value is not None}


def backlash_numbers(done: Estimate) -> dict[str, dict[str, object]]:
    """Return the mean backlash of each axis (approach in + minus approach in -), in um with its u: the number for a control's parameter."""
    columns, inverse = done.adjustment.design.columns, done.adjustment.fit.inverse
    found: dict[str, dict[str, object]] = {}
    for axis, letter in enumerate(AXIS_LETTERS):
        if not done.known.get(backlash(POSITIONING[axis]), False):
            continue
        mean = np.zeros(columns.count)
        mean[columns.of(REVERSAL_PART, axis, axis)] = 1.0 / (columns.nodes + 1)
        mean[columns.play + 4 * axis] = 1.0
        u = float(np.sqrt(max(float(mean @ inverse.solve(mean)), 0.0))) * inflation(done.adjustment)
        found[letter] = {"value": float(mean @ done.adjustment.fit.unknowns), "u": u, "unit": "um"}
    return found


def _extra(done: Estimate) -> dict[str, Any]:
    """Return the further entries of the JSON: fit, scale sum and closure residual."""
    found = done.adjustment
    number = done.number(SCALE_SUM)
    fit = {
        "readings": len(found.layout),
        "used": int(np.count_nonzero(np.isfinite(found.u_um))),
        "rank": found.fit.inverse.rank,
        "unknowns": found.design.columns.count,
        "degrees_of_freedom": found.fit.freedom,
        "chi_square": found.fit.chi_square,
        "u_enlarged_by": inflation(found),
    }
    extra: dict[str, Any] = {"fit": fit}
    if number is not None:
        extra["scale_sum_um"] = {"value": number[0], "u": number[1]}
    numbers = backlash_numbers(done)
    if numbers:
        extra["backlash"] = numbers
    closure = closure_report(found.layout)
    return extra if closure is None else {**extra, "closure_um": closure}


def _missing(done: Estimate) -> list[Finding]:
    """Return a finding for scales, squarenesses and functions that are not identified, with the cheapest runs that would help."""
    angular = [name for name in ROTATIONS if done.adjustment.estimates_angles and name not in done.adjustment.angles]
    groups = (
        ("scale-unidentified", "the scale of {} alone: EXX, EYY, EZZ are given there without slope", AXIS_LETTERS),
        ("squareness-unidentified", "the squareness {}", SQUARENESS),
        ("function-unidentified", "the shape of {}", DISPLACEMENTS),
        ("angle-unidentified", "the angular functions {}", tuple(shape(name) for name in angular)),
    )
    findings = []
    for code, words, names in groups:
        missing = [name for name in names if not done.known[name]]
        if missing:
            what = words.format(", ".join(name.removeprefix("shape ") for name in missing))
            text = f"the readings do not determine {what}; {_advice(done, missing)}"
            findings.append(Finding(code=code, severity="warning", text=text))
    return findings


def _advice(done: Estimate, missing: list[str]) -> str:
    found = done.adjustment
    parts = found.design.columns.parts
    advice = cheapest_runs(
        found.layout,
        found.design.chain,
        Model(angles=1 in parts, reversal=REVERSAL_PART in parts, play=found.layout.joined),
        missing,
        angles=found.angles,
        estimate_angles=found.estimates_angles,
    )
    return "no usual run would tell" if advice is None else f"add {advice}"


def _assumptions(done: Estimate) -> list[Finding]:
    """Return what the estimate takes for granted about angular errors."""
    found = done.adjustment
    unknown = [name for name in ROTATIONS if name not in found.angles]
    if found.estimates_angles or not unknown:
        return []
    what = "all angular errors" if len(unknown) == len(ROTATIONS) else ", ".join(unknown)
    within = f" within {UNKNOWN_ANGLE_URAD:g} urad" if 1 in found.design.columns.parts else ""
    effect = "10 urad over a metre can appear as 5 urad of squareness and 2.5 um of shape"
    text = f"{what} are taken as zero{within}: {effect}; give an angles file"
    return [Finding(code="angles-assumed-zero", severity="info", text=text)]
