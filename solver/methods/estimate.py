"""The estimator: one adjustment of all readings of a survey, and the quantities that the
readings identify."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.findings import Finding, info, warning
from stepdiag.base.messages import Message, Words, message
from stepdiag.base.result.members import Backlash, Backlashes, Fit, Length
from stepdiag.base.result.result import (
    AXIS_LETTERS,
    DISPLACEMENTS,
    POSITIONING,
    ROTATIONS,
    SQUARENESS,
    Function,
    Quantity,
    Result,
    Scale,
)
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment, adjust
from stepdiag.solver.adjustment.diagnostics import (
    closure_report,
    scale_misclosure,
    setup_findings,
    setup_reports,
)
from stepdiag.solver.adjustment.slips import slips_report
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.methods.angular import angle_findings, expected_angles
from stepdiag.solver.methods.coverage import coverage, coverage_findings
from stepdiag.solver.methods.doubt import doubt_findings
from stepdiag.solver.methods.finer import finer
from stepdiag.solver.methods.head_report import agreeing, beside_head, head_findings
from stepdiag.solver.methods.lengths import lengths_report, temperature_findings, tool_report
from stepdiag.solver.methods.standard_figures import standards_findings, standards_report
from stepdiag.solver.methods.volumetric import (
    as_known,
    budget,
    coarse_findings,
    drawn_surveys,
    left_with_head_um,
    make_posterior,
    volume_report,
    volume_shares_um,
    with_the_usual,
)
from stepdiag.solver.model.angles import Angles, angle_at_nodes
from stepdiag.solver.model.design import Model
from stepdiag.solver.model.lateral import MeasuredStraightness, at_targets
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.quantities import Quantities
from stepdiag.solver.model.reported import (
    REVERSAL_PART,
    SCALE_SUM,
    backlash,
    identified,
    reported,
    reversal,
    sloped,
    variance,
)
from stepdiag.solver.planning.identifiability import cheapest_runs, resolved_angles
from stepdiag.solver.uncertainty.machine import usual_sizes_of
from stepdiag.solver.uncertainty.smooth import BENDS, smoothed
from stepdiag.solver.uncertainty.spread import Spread, deviation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """An adjustment, with values, standard uncertainties and identifiability of all reported
    quantities. ``u`` is the combined uncertainty, ``u_readings`` its part by the noise of the
    readings."""

    adjustment: Adjustment
    quantities: Quantities
    value: Vector
    u: Vector
    u_readings: Vector
    known: dict[str, bool]
    spread: Spread

    @property
    def gain(self) -> Vector:
        """Return the linear operator (q, m): quantities = gain @ deviation_um."""
        fit = self.spread.fit
        spread = fit.inverse.solve(self.quantities.combination.dense().T)
        direct = fit.rows.times(spread) * fit.weight[:, None]
        through = fit.causes.left @ (
            fit.amount_covariance @ self.spread.moved(self.quantities.combination).T
        )
        matrix: Vector = (direct + through).T
        return matrix[:, : len(self.adjustment.layout)]

    @property
    def covariance(self) -> Vector:
        spread = self.spread.fit.inverse.solve(self.quantities.combination.dense().T)
        moved = self.spread.moved(self.quantities.combination)
        matrix: Vector = (
            self.quantities.combination.times(spread) + moved @ self.spread.amount @ moved.T
        )
        return matrix

    def number(self, name: str) -> tuple[float, float, float] | None:
        """Return the value of a number, its combined standard uncertainty and the part by the
        readings; None if the number is not identified."""
        row = self.quantities.of(name)[0]
        return (
            (float(self.value[row]), float(self.u[row]), float(self.u_readings[row]))
            if self.known[name]
            else None
        )

    def curve(self, name: str, nodes: int) -> tuple[Vector, Vector, Vector] | None:
        """Return the values of a function at nodes 0 .. n, its combined uncertainties and the
        parts by the readings; None if the function is not identified."""
        if not self.known[name]:
            return None
        rows = self.quantities.of(name)
        at = self.quantities.node[rows]
        columns = np.zeros((3, nodes + 1))
        columns[:, at] = self.value[rows], self.u[rows], self.u_readings[rows]
        return columns[0], columns[1], columns[2]


def estimate(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    straightness: Sequence[MeasuredStraightness] = (),
    assumed: Assumptions | None = None,
) -> Estimate:
    """Adjust a survey and compute every quantity. Raises the errors of
    `solver.adjustment.adjustment.adjust`."""
    adjustment = adjust(
        layout, chain, angles=angles, straightness=straightness, assumed=assumed
    )
    found = reported(adjustment.design)
    spread = smoothed(spread_of(adjustment), adjustment.design, found)
    inverse = spread.fit.inverse
    moved = spread.moved(found.combination)
    alone = variance(found, inverse)
    return Estimate(
        adjustment=adjustment,
        quantities=found,
        value=found.combination.times(spread.fit.unknowns),
        u=deviation(
            alone + np.maximum(spread.variance(moved), spread.variance_by_readings(moved))
        ),
        u_readings=deviation(alone + spread.variance_by_readings(moved)),
        # with one increment a function has only its two ends: its shape is zero and no combination
        # of unknowns
        known={
            **dict.fromkeys(DISPLACEMENTS, True),
            **identified(found, inverse, usual_sizes_of(adjustment.assumed)),
            **({} if layout.volume.solid else {SCALE_SUM: False}),
        },
        spread=spread,
    )


def spread_of(found: Adjustment) -> Spread:
    group = np.repeat(
        np.arange(len(found.effects)), [effect.count for effect in found.effects]
    )
    return Spread(
        found.fit, group, tuple(effect.name for effect in found.effects), found.sizes
    )


def solve_estimate(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    straightness: Sequence[MeasuredStraightness] = (),
    assumed: Assumptions | None = None,
    trials: int = 0,
) -> Result:
    """Return the result of the estimator. A quantity that is not identified is None, and a finding
    states the remedy.

    With ``trials`` the result also contains the scatter of simulated surveys (JCGM 101).
    """
    straightness = at_targets(straightness, layout)
    done, of_head = agreeing(
        lambda kept: estimate(
            layout, chain, angles=angles, straightness=kept, assumed=assumed
        ),
        straightness,
    )
    found = done.adjustment
    reports = setup_reports(found)
    resolved = resolved_angles(layout, chain, found.shapes.names)
    findings = (
        *found.layout.findings,
        *_missing(done),
        *found.findings,
        *setup_findings(found, reports),
        *standards_findings(layout),
        *temperature_findings(layout.temperature_c, found.assumed),
    )
    factors = coverage(found, done.quantities, done.known, done.u, done.u_readings)
    expected = expected_angles(found, done.spread)
    errors, of_head = beside_head(_errors(done), of_head, straightness, found)
    result = Result(
        volume=layout.volume,
        chain=chain,
        method="estimate",
        errors={**errors, **{name: expected[name] for name in resolved}},
        expected={
            name: function
            for name, function in expected.items()
            if name not in resolved and layout.volume.solid
        },
        reversal=_reversal(done),
        squareness={name: _quantity(done.number(name)) for name in SQUARENESS},
        scale={letter: _scale(done.number(letter)) for letter in AXIS_LETTERS},
        setups=reports,
        findings=(*findings, *coarse_findings(errors), *head_findings(of_head)),
    )
    texts: dict[str, Words] = {
        "readings": _noise_text(found),
        **{effect.name: effect.text for effect in found.effects},
    }
    if BENDS in done.spread.names:
        texts[BENDS] = message("assumed-bends")
    shares: dict[str, float] = {}
    if layout.volume.solid:
        result, shares = _over_the_volume(result, done, resolved)
    return replace(
        _with_fit(result, done),
        findings=(*result.findings, *coverage_findings(factors)),
        assumed=found.assumed.stated(),
        lengths=lengths_report(
            result.scale,
            found.assumed,
            known=bool(np.all(np.isfinite(found.layout.temperature_c))),
        ),
        tool=tool_report(errors, expected, found.assumed) if layout.volume.solid else None,
        head_straightness=of_head or None,
        budget=budget(
            done.spread, done.quantities, done.known, done.u, done.u_readings, texts, shares
        ),
        coverage=factors or None,
        standards=standards_report(layout, found.assumed),
        monte_carlo=drawn_surveys(done.spread, done.quantities, done.known, done.u, trials)
        if trials
        else None,
    )


def _over_the_volume(
    result: Result, done: Estimate, resolved: Sequence[str]
) -> tuple[Result, dict[str, float]]:
    found = done.adjustment
    wider = with_the_usual(found, done.spread, done.quantities, done.known)
    seen = _barely_seen(done)
    machines = as_known(found, seen, done.quantities, done.known)
    posterior = make_posterior(found, seen, wider, machines, done.known, result.errors)
    whole = replace(result, posterior=posterior)
    predicted, u_um = volume_report(whole, posterior)
    angles = angle_findings(
        found, done.spread, resolved, left_with_head_um(found, wider, u_um)
    )
    findings = (*whole.findings, *angles, *doubt_findings(found))
    shares = volume_shares_um(found, seen, machines, posterior, u_um)
    return replace(
        whole, findings=findings, volumetric_u_um=u_um, predicted=predicted
    ), shares


def _barely_seen(done: Estimate) -> Spread:
    determined = identified(done.quantities, done.spread.fit.inverse, {})
    kept = {
        name: known or not determined.get(name, True) for name, known in done.known.items()
    }
    return with_the_usual(done.adjustment, done.spread, done.quantities, kept)


def _noise_text(found: Adjustment) -> Message:
    return message("assumed-readings", repeatability_um=found.assumed.repeatability_um)


def _quantity(number: tuple[float, float, float] | None) -> Quantity:
    return (
        Quantity(value=None, u=None)
        if number is None
        else Quantity(value=number[0], u=number[1], u_readings=number[2])
    )


def _scale(number: tuple[float, float, float] | None) -> Scale:
    if number is None:
        return Scale(value=None, u=None, identified=False)
    return Scale(value=number[0], u=number[1], identified=True, u_readings=number[2])


def _errors(done: Estimate) -> dict[str, Function]:
    errors = {
        name: _positioning(done, name) if name in POSITIONING else _function(done, name, None)
        for name in DISPLACEMENTS
    }
    return {
        **errors,
        **{
            name: _known_angle(done, name)
            for name in ROTATIONS
            if name in done.adjustment.angles
        },
    }


def _positioning(done: Estimate, name: str) -> Function:
    function = _function(done, name, sloped(name))
    stands_as = sloped(name) if function.slope_identified else name
    return finer(done.adjustment, done.spread, done.quantities, stands_as, function, name)


def _function(done: Estimate, name: str, with_slope: str | None) -> Function:
    """Return a function with its slope. If the slope is not identified, the slope is omitted. If
    the shape is not identified, the values are None."""
    volume, axis = done.adjustment.layout.volume, AXIS_LETTERS.index(name[-1])
    full = done.curve(with_slope, volume.increments) if with_slope else None
    value, u, u_readings = full or done.curve(name, volume.increments) or (None, None, None)
    return Function(
        position_mm=volume.nodes_mm(axis)
        if volume.travelled[axis]
        else volume.nodes_mm(axis)[:1],
        value=value,
        u=u,
        unit="um",
        slope_identified=with_slope is None or full is not None,
        u_readings=u_readings,
    )


def _known_angle(done: Estimate, name: str) -> Function:
    volume = done.adjustment.layout.volume
    value, stated = (
        np.concatenate([[0.0], column])
        for column in angle_at_nodes(done.adjustment.angles[name], name, volume)
    )
    u: Vector | None = stated if np.all(np.isfinite(stated)) else None
    by_readings = u
    adjusted = done.curve(name, volume.increments) if u is not None else None
    if adjusted is not None:
        value, u, by_readings = value + adjusted[0], adjusted[1], adjusted[2]
    position = volume.nodes_mm(AXIS_LETTERS.index(name[-1]))
    return Function(
        position_mm=position, value=value, u=u, unit="urad", u_readings=by_readings
    )


def _reversal(done: Estimate) -> dict[str, Function]:
    """Return the reversal function of every error whose reversal is identified. The value at the
    low end is 0 with u = 0 if it was not measured."""
    if REVERSAL_PART not in done.adjustment.design.columns.parts:
        return {}
    whole = {name: done.known.get(backlash(name), False) for name in DISPLACEMENTS}
    travelled = dict(zip(AXIS_LETTERS, done.adjustment.layout.volume.travelled, strict=True))
    seen = [name for name in DISPLACEMENTS if done.known[name] and travelled[name[2]]]
    functions = {
        name: _function(done, backlash(name) if whole[name] else reversal(name), None)
        for name in seen
    }
    return {
        name: function for name, function in functions.items() if function.value is not None
    }


def backlash_numbers(done: Estimate) -> Backlashes | None:
    """Return the mean backlash of each axis (approach in + minus approach in -) in um with its
    u, as the backlash parameter of a control."""
    columns = done.adjustment.design.columns
    found: dict[str, Backlash] = {}
    for axis, letter in enumerate(AXIS_LETTERS):
        if not done.known.get(backlash(POSITIONING[axis]), False):
            continue
        at = np.append(columns.of(REVERSAL_PART, axis, axis), columns.play + 4 * axis)
        mean = Rows(
            at[None, :],
            np.append(np.full(columns.nodes, 1.0 / (columns.nodes + 1)), 1.0)[None, :],
            columns.count,
        )
        alone = mean.times(done.spread.fit.inverse.solve(mean.dense().ravel())).item()
        u = float(
            np.sqrt(max(alone, 0.0) + done.spread.variance(done.spread.moved(mean)).item())
        )
        found[letter] = Backlash(value=mean.times(done.spread.fit.unknowns).item(), u=u)
    return Backlashes(**found) if found else None


def _with_fit(result: Result, done: Estimate) -> Result:
    found = done.adjustment
    solid = found.layout.volume.solid
    number = done.number(SCALE_SUM) if solid else None
    misclosed = scale_misclosure(found)
    fit = Fit(
        readings=len(found.layout),
        used=int(np.count_nonzero(np.isfinite(found.u_um))),
        rank=found.fit.inverse.rank,
        unknowns=found.design.columns.count,
        degrees_of_freedom=found.fit.freedom,
        chi_square=found.fit.chi_square,
    )
    return replace(
        result,
        fit=fit,
        scale_sum_um=None if number is None else Length(value=number[0], u=number[1]),
        scale_misclosure_um=None
        if misclosed is None
        else Length(value=misclosed[0], u=misclosed[1]),
        backlash=backlash_numbers(done),
        unseen_slip=slips_report(found.as_usual(), found.layout, found.design)
        if solid
        else None,
        closure_um=closure_report(found.layout),
    )


_UNIDENTIFIED: tuple[
    Literal["unidentified.scale", "unidentified.squareness", "unidentified.function"], ...
] = (
    "unidentified.scale",
    "unidentified.squareness",
    "unidentified.function",
)


def _missing(done: Estimate) -> list[Finding]:
    if not done.adjustment.layout.volume.solid:
        return [_standing(done)]
    lacking = [
        [name for name in names if not done.known[name]]
        for names in (AXIS_LETTERS, SQUARENESS, DISPLACEMENTS)
    ]
    return [
        warning(key, names=names, advice=_advice(done, names))
        for key, names in zip(_UNIDENTIFIED, lacking, strict=True)
        if names
    ]


def _standing(done: Estimate) -> Finding:
    moved = done.adjustment.layout.volume.travelled
    standing = [
        letter for letter, travels in zip(AXIS_LETTERS, moved, strict=True) if not travels
    ]
    missing: list[str | Message] = [
        name for name in (*DISPLACEMENTS, *SQUARENESS) if not done.known[name]
    ]
    missing += [
        message("scale-of", axis=letter) for letter in AXIS_LETTERS if not done.known[letter]
    ]
    return info("unidentified.standing", axes=standing, names=missing)


def _advice(done: Estimate, missing: list[str]) -> Message:
    found = done.adjustment
    parts = found.design.columns.parts
    advice = cheapest_runs(
        found.layout,
        found.design.chain,
        Model(reversal=REVERSAL_PART in parts, play=found.layout.joined),
        missing,
    )
    if advice is None:
        return message("no-run-helps")
    if not advice.runs:
        return message("less-noise")
    return message(
        "runs-to-add", runs=[run.setup for run in advice.runs], minutes=advice.minutes
    )
