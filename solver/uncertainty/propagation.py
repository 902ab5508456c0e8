"""How readings become quantities: the estimator's linear operator, and the budget of a survey through it."""

from dataclasses import dataclass, replace

import numpy as np

from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.diagnostics import chi_square_limit
from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.linear.fit import Fit
from stepdiag.solver.linear.least_squares import Inverse, invert
from stepdiag.solver.linear.rows import Rows
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.priors import UNKNOWN_ANGLE_URAD
from stepdiag.solver.model.quantities import Quantities, quantities
from stepdiag.solver.result.result import ROTATIONS
from stepdiag.solver.uncertainty.budget import Budget, Source, budget, response, with_tilt_share
from stepdiag.solver.uncertainty.monte_carlo import TRIALS, Intervals, monte_carlo
from stepdiag.solver.uncertainty.sources import Assumptions, reading_u_um, sources


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Operator:
    """The linear map ``quantities = gain @ targets``, gain (q, rows), of the quantities that the rows identify.

    ``unidentified`` are those they do not: a function counts as unidentified if one of its nodes is. ``hidden`` is the number
    of independent combinations of all unknowns that no row shows, rigid rotations and nuisances included.
    """

    quantities: Quantities
    unidentified: Quantities
    gain: Vector
    hidden: int


def operator_of(design: Design, rows: Rows, weight: Vector, inverse: Inverse) -> Operator:
    """Return the operator of weighted least squares: ``rows`` are the design's, further ones (priors) after them."""
    asked = quantities(design.columns, design.volume)
    seen = inverse.sees(asked.combination)
    whole = np.array([bool(seen[asked.of(name)].all()) for name in asked.names])
    known = asked.select(np.flatnonzero(whole))
    return Operator(
        quantities=known,
        unidentified=asked.select(np.flatnonzero(~whole)),
        gain=_gain(rows, weight, inverse, known),
        hidden=inverse.null.shape[1],
    )


def _gain(rows: Rows, weight: Vector, inverse: Inverse, known: Quantities) -> Vector:
    gain: Vector = (weight[:, None] * rows.times(inverse.solve(known.combination.dense().T))).T
    return gain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyUncertainty:
    """The budget of a survey: columns of the budget are the operator's quantities, ``sources`` have a pattern on every row."""

    operator: Operator
    sources: tuple[Source, ...]
    budget: Budget

    def u(self, name: str) -> Vector | None:
        """Return the combined standard uncertainty of a function's nodes or of a number, None where it is not identified."""
        columns = self.operator.quantities.of(name)
        return self.budget.combined[columns] if len(columns) else None

    def shares(self) -> dict[str, dict[str, float]]:
        """Return per function or number the contribution of every source, root mean square over the nodes."""
        known = self.operator.quantities
        mean_square = {name: np.mean(self.budget.u[:, known.of(name)] ** 2, axis=1) for name in known.groups}
        return {name: dict(zip(self.budget.names, np.sqrt(square).tolist(), strict=True)) for name, square in mean_square.items()}

    def assumptions(self) -> dict[str, str]:
        """Return what each source assumes, in words."""
        return dict(zip(self.budget.names, self.budget.texts, strict=True))

    def report(self) -> dict[str, dict[str, object]]:
        """Return the budget as plain JSON (k = 1): what was assumed, the shares per function or number by source, and their combination."""
        known, combined = self.operator.quantities, self.budget.combined
        total = {name: float(np.sqrt(np.mean(combined[known.of(name)] ** 2))) for name in known.groups}
        shares = self.shares()
        return {"assumptions": dict(self.assumptions()), "shares": dict(shares), "combined": dict(total)}

    def responses(self) -> Vector:
        """Return how every independent cause moves every quantity, shape (q, causes): its square is the covariance."""
        return np.column_stack([response(self.operator.gain, source) for source in self.sources])

    def monte_carlo(self, trials: int = TRIALS, seed: int = 0) -> Intervals:
        """Return the coverage intervals of every quantity by Monte Carlo through the same operator (JCGM 101)."""
        return monte_carlo(self.operator.gain, self.sources, trials=trials, seed=seed)


def survey_uncertainty(
    layout: Layout, chain: str, assumed: Assumptions, model: Model | None = None, *, tilt_share: bool = True
) -> SurveyUncertainty:
    """Return what a survey's stops, under the assumptions, would make of every quantity that they identify.

    Needs the geometry of the readings only. With ``model.angles`` the angular functions are unknowns. ``tilt_share`` splits off the
    price of estimating the tilts, which takes a second inversion and leaves the combined uncertainty as it is.
    """
    model = model or Model()
    if model.angles:
        assumed = replace(assumed, angle_urad={})
    design = build_design(layout, chain, model)
    weight = 1.0 / reading_u_um(layout, assumed) ** 2
    operator = operator_of(design, design.rows, weight, invert(design.rows, weight, design.blocks))
    causes = sources(layout, chain, assumed)
    spent = budget(operator.gain, causes)
    if tilt_share:
        spent = _split(spent, design, design.rows, weight, operator, causes[0])
    return SurveyUncertainty(operator=operator, sources=causes, budget=spent)


def adjusted_uncertainty(adjustment: Adjustment, assumed: Assumptions) -> SurveyUncertainty:
    """Return the budget of a survey as it was adjusted: with its weights, without the stops that were left out.

    The readings' own uncertainty is the one the adjustment used. The repeatability grows where the residuals are larger than all
    sources together explain. Angular functions that were given count with their own uncertainty, and no longer as unmodelled.
    """
    fit, count = adjustment.fit, len(adjustment.layout)
    own = np.where(np.isfinite(adjustment.u_um), adjustment.u_um, 0.0)
    # angles that are unknowns of the adjustment count by their prior rows, given or not
    unknown = {} if 1 in adjustment.design.columns.parts else assumed.angle_urad
    unknown = {name: size for name, size in unknown.items() if name not in adjustment.angles}
    causes = sources(replace(adjustment.layout, u_um=own), adjustment.design.chain, replace(assumed, angle_urad=unknown))
    further = len(fit.rows) - count
    causes = tuple(replace(cause, pattern_um=_padded(cause.pattern_um, further)) for cause in causes)
    causes = tuple(_as_shown(cause, causes, adjustment) if cause.name == "repeatability" else cause for cause in causes)
    known = _known_besides(adjustment)
    if known:
        u = np.concatenate([np.zeros(count), 1.0 / np.sqrt(fit.weight[count:])])
        causes = (*causes, Source(name="known angles", text=known, pattern_um=u))
    operator = operator_of(adjustment.design, fit.rows, fit.weight, fit.inverse)
    spent = _split(budget(operator.gain, causes), adjustment.design, fit.rows, fit.weight, operator, causes[0])
    return SurveyUncertainty(operator=operator, sources=causes, budget=spent)


def _known_besides(adjustment: Adjustment) -> str:
    """Return in words what is known besides the readings, empty for nothing."""
    columns = adjustment.design.columns
    words = [f"{', '.join(adjustment.angles)} as given"] if adjustment.angles else []
    if adjustment.angles and 1 in columns.parts and not adjustment.estimates_angles and len(adjustment.angles) < len(ROTATIONS):
        words.append(f"the other angles zero within {UNKNOWN_ANGLE_URAD:g} urad")
    if columns.line < columns.count:
        words.append("the head's straightness as stated")
    return ", ".join(words)


def _as_shown(repeatability: Source, causes: tuple[Source, ...], adjustment: Adjustment) -> Source:
    """Return the repeatability, enlarged where the residuals are significantly larger than all sources together make them."""
    fit = adjustment.fit
    expected = sum(_expected_chi_square(fit, cause) for cause in causes)
    if fit.freedom < 1 or fit.chi_square <= chi_square_limit(fit.freedom) * expected / fit.freedom:
        return repeatability
    own = _expected_chi_square(fit, repeatability)
    if own == 0.0:
        repeatability = replace(repeatability, pattern_um=np.where(np.arange(len(fit.rows)) < len(adjustment.layout), 1.0, 0.0))
        expected, own = expected + _expected_chi_square(fit, repeatability), _expected_chi_square(fit, repeatability)
    factor = float(np.sqrt((fit.chi_square - expected + own) / own))
    pattern = factor * repeatability.pattern_um
    text = f"the residuals show that the machine comes back to a target within {pattern.max():.2g} um only"
    return replace(repeatability, text=text, pattern_um=pattern)


def _expected_chi_square(fit: Fit, cause: Source) -> float:
    """Return what a source adds to the weighted sum of squared residuals on average."""
    if cause.pattern_um.ndim == 1:
        return float(np.sum(fit.weight * cause.pattern_um**2 * fit.redundancy))
    left = cause.pattern_um - fit.rows.times(fit.operator @ cause.pattern_um)
    return float(np.sum(fit.weight[:, None] * left**2))


def _padded(pattern: Vector, further: int) -> Vector:
    return np.pad(pattern, ((0, further), (0, 0))[: pattern.ndim])


def _split(spent: Budget, design: Design, rows: Rows, weight: Vector, operator: Operator, reading: Source) -> Budget:
    known = response(_tilts_known_gain(design, rows, weight, operator.quantities), reading)
    return with_tilt_share(spent, np.linalg.norm(known, axis=1))


def _tilts_known_gain(design: Design, rows: Rows, weight: Vector, known: Quantities) -> Vector:
    """Return the gain of the same quantities were every mirror tilt known: the tilts are no unknowns then."""
    tilts = np.arange(design.columns.tilt, design.columns.drift)
    without = replace(rows, value=np.where(np.isin(rows.column, tilts), 0.0, rows.value))
    return _gain(without, weight, invert(without, weight, design.blocks), known)
