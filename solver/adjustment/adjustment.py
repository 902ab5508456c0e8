from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import is_

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.conformity import COVERAGE
from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, error, info
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import counts
from stepdiag.solver.adjustment.evidence import DECIMALS, ODDS, PLACE, PRODUCT, STEP
from stepdiag.solver.adjustment.exchanged import Programs, rows_of
from stepdiag.solver.adjustment.explanations import (
    Explained,
    effects_beside,
    explained,
    families_beside,
    most_odds_beside,
)
from stepdiag.solver.adjustment.faults import (
    EFFECTS,
    TRIAL,
    Suspicion,
    effects_for,
    families,
    most_suspicious,
    trial_of,
    weight_without,
    with_apart,
)
from stepdiag.solver.adjustment.naming import (
    name_excess,
    name_explained,
    name_names,
    name_suspicion,
)
from stepdiag.solver.adjustment.scatter import (
    FIRST,
    ROUNDS,
    Misses,
    Scatter,
    estimated,
    further,
    unshown,
)
from stepdiag.solver.adjustment.signs import unseen_signs, wrong_signs
from stepdiag.solver.linear.components import Sizes, likelier, scored, sized
from stepdiag.solver.linear.fit import Fit, fit
from stepdiag.solver.linear.mixed import AnyFit, Causes, MixedFit
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.between import (
    BETWEEN,
    Between,
    between_beside_head,
    between_of,
    effect_between,
)
from stepdiag.solver.model.design import Design, Model, build_design, machine_rows
from stepdiag.solver.model.effects import (
    ANGLES,
    BESIDE,
    FIRST_STOPS,
    GROWTH,
    ONE_SCALE,
    ONE_WALK,
    SETUP_SCALE,
    SHORT_ANGLES,
    TURNING,
    AngleShapes,
    Effect,
    angle_shapes,
    effects_of,
)
from stepdiag.solver.model.lateral import (
    MeasuredStraightness,
    lateral_angles,
    lateral_rows,
    of_known_angles,
)
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import assumed_noise, variance_scale
from stepdiag.solver.model.priors import (
    angular_effect_um,
    has_stated_u,
    make_prior,
    origin_pattern,
)
from stepdiag.solver.model.warmth import at_one_temperature

TILT_ROUNDS = 2
SIZE_ROUNDS = 4
EARLY = (*TURNING, BETWEEN, GROWTH, SETUP_SCALE, FIRST_STOPS)
"""Effects whose sizes are estimated before the search for wrong stops; none of them can explain
a single wrong stop."""
FOUND = (*EFFECTS.values(), TRIAL)
"""Effects that the search for contradictions adds to the model."""
SETTLED = 0.02
"""Relative change of a size below which its iteration ends."""
PLAUSIBLE = {SETUP_SCALE: 2.0}
"""Largest size of an effect in the search for contradictions, relative to its usual size (default
1). One length compares all seven setups, so a survey cannot distinguish large scales of all setups
from one wrong setup. The ratio 2 for scales comes from the scatter of ten setups in one
workshop."""
MOST_TILT_MRAD = 200.0
"""Largest accepted mirror tilt. A tenth of this tilt already moves the beam off the laser within
0.25 m, so a larger estimate has another cause."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Adjustment:
    """The fit of a survey and its findings. The rows of the fit are the readings (first m), the
    straightness of the head, and the priors.

    ``effects`` are the random effects in the order of the fit. ``shapes`` are the angular
    functions. ``between`` are the deviations between the nodes. ``sizes`` are the estimated sizes
    of the random effects. ``u_um`` (m,) is the standard uncertainty of every reading by noise,
    infinite for an omitted stop. ``explained`` contains errors outside the model. ``scatter``
    contains the machine's repeatability and the noise of its setups.
    """

    layout: Layout
    design: Design
    fit: MixedFit
    angles: Angles
    assumed: Assumptions
    effects: tuple[Effect, ...]
    shapes: AngleShapes
    between: Between
    sizes: Sizes
    scatter: Scatter
    u_um: Vector
    explained: Explained
    findings: tuple[Finding, ...] = field(default=())

    @property
    def tilt_mrad(self) -> Vector:
        """Return the mirror tilt of every setup relative to its diagonal in mrad, shape (setups,
        3)."""
        return _tilts(
            self.design, _smallest_machine(self.design, self.fit), len(self.layout.setups)
        )

    def first_cause(self, name: str) -> int:
        """Return the index of the first column of a random effect. Raises ``ValueError`` for an
        effect that is not in the fit."""
        names = [effect.name for effect in self.effects]
        return sum(effect.count for effect in self.effects[: names.index(name)])

    @property
    def products(self) -> dict[int, float]:
        """Return the column and the size in um of each error in `PRODUCTS`, in the order of
        `PRODUCTS`."""
        size_um = self.explained.spread[self.explained.of(PRODUCT)]
        return (
            dict(enumerate(size_um.tolist(), self.first_cause(BESIDE)))
            if np.any(size_um)
            else {}
        )

    def as_usual(self, *found: str) -> MixedFit:
        """Return the fit with every random effect limited to its usual size, so that no large
        effect hides a contradiction. Growth, the backlash at first stops and the effects ``found``
        keep their estimated size."""
        return _as_usual(self.fit, self.effects, self.sizes, found)

    def plausible(self, *found: str) -> MixedFit:
        """Return the fit `as_usual`, in which the effects ``found`` have their estimated size,
        but at least the assumed size."""
        kept = np.array([effect.name in found for effect in self.effects], dtype=np.bool_)
        factor = np.where(kept, np.maximum(1.0, 1.0 / self.sizes.factor), 1.0)
        return sized(
            self.as_usual(*found),
            np.repeat(factor, [effect.count for effect in self.effects]),
        )

    @property
    def repaired_um(self) -> Vector:
        """Return the deviation of each reading in um without the detected steps of the count,
        shape (m,); NaN for an omitted stop."""
        edges = np.cumsum([0, *(effect.count for effect in self.effects)])
        steps = sum(
            (
                effect.pattern_um @ self.fit.amount[first : first + effect.count]
                for effect, first in zip(self.effects, edges.tolist(), strict=False)
                if effect.name == EFFECTS[STEP]
            ),
            np.zeros(len(self.layout)),
        )
        return np.where(np.isfinite(self.u_um), self.layout.deviation_um - steps, np.nan)

    @property
    def residual_um(self) -> Vector:
        """Return the difference between each reading and the machine in um, including the
        positioning deviations of the moves, shape (m,)."""
        columns, arrival = self.design.columns, self.layout.arrival
        missed = self.fit.unknowns[columns.miss :]
        by_miss = (
            missed[np.maximum(arrival, 0)] * (arrival >= 0)
            if len(missed)
            else np.zeros(arrival.shape)
        )
        found: Vector = self.fit.residual[: len(self.layout)] + np.sum(
            self.layout.direction * by_miss, axis=1
        )
        return found


def _as_usual(
    fit: MixedFit, effects: Sequence[Effect], sizes: Sizes, found: Collection[str] = ()
) -> MixedFit:
    kept = np.array(
        [effect.name in (*found, GROWTH, FIRST_STOPS) for effect in effects], dtype=np.bool_
    )
    usual = np.array([PLAUSIBLE.get(effect.name, 1.0) for effect in effects])
    factor = np.where(
        kept,
        1.0,
        np.where(usual > 1.0, usual / sizes.factor, np.minimum(1.0, 1.0 / sizes.factor)),
    )
    beside = {ONE_SCALE, ONE_WALK, BESIDE}.difference(found)
    factor[[effect.name in beside for effect in effects]] = 0.0
    return sized(fit, np.repeat(factor, [effect.count for effect in effects]))


def adjust(
    layout: Layout,
    chain: str,
    *,
    angles: Angles | None = None,
    straightness: Sequence[MeasuredStraightness] = (),
    assumed: Assumptions | None = None,
) -> Adjustment:
    """Return the adjustment of a survey; the ``straightness`` of a 4-DOF head adds rows.

    Known angular functions are subtracted (theory 5.2) and adjusted within their uncertainty.
    Unknown angular functions, drift and the scales of setups are random effects of the ``assumed``
    sizes, unless the readings show other sizes. Raises ``UsageError`` for an invalid chain and
    ``DataError`` for angles that do not cover the volume.
    """
    usual = assumed or Assumptions()
    return _Task(
        at_one_temperature(layout, usual), chain, angles or {}, straightness, usual
    ).run()


def _both_ways(layout: Layout) -> bool:
    ways = {(key.setup, key.outward) for key in layout.passes}
    return any((name, not outward) in ways for name, outward in ways)


class _Task:
    def __init__(
        self,
        layout: Layout,
        chain: str,
        angles: Angles,
        straightness: Sequence[MeasuredStraightness],
        assumed: Assumptions,
    ) -> None:
        self.layout = layout
        self.chain = chain
        self.angles = angles
        self.assumed = assumed
        self.straightness = straightness
        self.model = Model(
            angles=has_stated_u(angles),
            reversal=_both_ways(layout),
            play=layout.joined,
            lines=len(straightness),
            misses=assumed.repeatability_um > 0.0,
        )
        self.design = build_design(layout, chain, self.model)
        lateral = lateral_rows(self.design, straightness, angles)
        prior = make_prior(self.design, angles)
        self.u = np.concatenate([np.ones(len(layout)), lateral.u, prior.u])
        self.usual_u = self.u.copy()
        first = len(self.u) - len(prior.u)
        self.sized = [first + rows for rows in prior.found]
        self.misses = Misses(
            rows=first + prior.misses, kind=_kinds_of_misses(layout)[: len(prior.misses)]
        )
        self.usual_scatter = Scatter.assumed(layout, assumed)
        self._take(self.usual_scatter)
        self.kept = np.ones(len(self.u))
        self.findings: list[Finding] = []
        self.rows = self.design.rows.followed_by(lateral.rows).followed_by(prior.rows)
        freed = layout.deviation_um - angular_effect_um(layout, chain, angles)
        self.target = np.concatenate([freed, lateral.target, np.zeros(len(prior.u))])
        self.shapes = angle_shapes(layout, angles, assumed)
        self.between = between_of(layout, straightness)
        self.effects = list(effects_of(layout, chain, self.shapes, assumed))
        if self.between.count:
            self.effects.append(effect_between(layout, self.between))
        turned = np.pad(
            lateral_angles(self.design, straightness, self.shapes),
            ((0, len(prior.u)), (0, 0)),
        )
        self.beside = {
            ANGLES: turned[:, : self.shapes.long],
            SHORT_ANGLES: turned[:, self.shapes.long :],
            BETWEEN: np.pad(
                between_beside_head(layout, straightness, self.between),
                ((0, len(prior.u)), (0, 0)),
            ),
            "angle origin": np.pad(
                origin_pattern(self.design, angles, len(prior.u)),
                ((len(lateral.u), 0), (0, 0)),
            ),
        }
        if self.beside["angle origin"].shape[1]:
            text = message("assumed-angle-origin")
            nothing = np.zeros((len(layout), self.beside["angle origin"].shape[1]))
            self.effects.append(Effect(name="angle origin", text=text, pattern_um=nothing))
        self.sizes = Sizes(np.ones(0), np.ones(0, dtype=np.bool_))
        self.known: tuple[Fit | None, tuple[Effect, ...], Causes | None] = (None, (), None)
        self.clean = False

    def run(self) -> Adjustment:
        current = self._first_scatter()
        current = self._with_right_signs(self._with_right_names(current))
        for suspicious in self._suspicions(current):
            current = suspicious
        # the sizes of linear and irregular drift are estimated without the wrong stops, because a
        # larger size could explain a wrong stop
        self.clean = True
        current = self._find_scatter(
            self._find_sizes(self._with_effects(current.fixed)), robust=False
        )
        current = self._open_beside(current)
        self.findings += assumed_noise(unshown(self.scatter, self.layout))
        used = self.kept > 0
        u = np.where(used, self.u / np.sqrt(np.where(used, self.kept, np.nan)), np.inf)
        return Adjustment(
            layout=self.layout,
            design=self.design,
            fit=current,
            angles=self.angles,
            assumed=self.assumed,
            effects=tuple(self.effects),
            shapes=self.shapes,
            between=self.between,
            sizes=self.sizes,
            scatter=self.scatter,
            u_um=u[: len(self.layout)],
            explained=self.explained,
            findings=tuple(self.findings),
        )

    def _first_scatter(self) -> MixedFit:
        """Return the fit with the first estimate of the scatter.

        The search for a step of millimetres comes first, because this step would enlarge the
        estimated scatter. The search assumes the usual sizes of all effects. This search is omitted
        if the readings scatter less than assumed.
        """
        current = self._fit_with_tilts()
        within = current.chi_square <= current.freedom
        worst = None if within else self._worst(current)
        if worst is None or not worst.decided or worst.best.kind not in (STEP, PLACE):
            return self._find_scatter(current, robust=True)
        self.effects.append(trial_of(self.layout, worst))
        current = self._find_scatter(self._fit_with_tilts(), robust=True)
        self.effects.pop()
        return self._with_effects(current.fixed)

    def _open_beside(self, current: MixedFit) -> MixedFit:
        """Return the fit with the explanations outside the model (`explained`) as additional random
        effects.

        The search uses a fit whose growth and scales of setups are not larger than usual, because
        large ones would explain the same lengths.
        """
        alike = np.array(
            [effect.name in (GROWTH, SETUP_SCALE) for effect in self.effects], dtype=np.bool_
        )
        factor = np.where(alike, np.minimum(1.0, 1.0 / self.sizes.factor), 1.0)
        usual = sized(current, np.repeat(factor, [effect.count for effect in self.effects]))
        every = counts(usual.fixed, self.layout)
        growth = [effect.pattern_um for effect in self.effects if effect.name == GROWTH]
        self.explained = explained(
            usual, self.layout, np.hstack([np.zeros((len(self.layout), 0)), *growth]), every
        )
        self.findings += name_explained(self.layout, self.explained)
        opened = effects_beside(self.layout, self.explained)
        if not opened:
            return current
        self.effects += opened
        self.sizes = Sizes(
            np.pad(self.sizes.factor, (0, len(opened)), constant_values=1.0),
            np.pad(self.sizes.sought, (0, len(opened))),
        )
        causes = self._causes(current.fixed, self.effects)
        return MixedFit(
            current.fixed,
            causes,
            np.repeat(self.sizes.factor, [effect.count for effect in self.effects]),
        )

    def _with_right_names(self, current: MixedFit) -> MixedFit:
        """Return the fit with the readings under their right names, and a finding, if only other
        names agree with all other readings. If other names are probable, a finding lists them.
        """
        count = len(self.layout)
        usual = _as_usual(current, self.effects, self.sizes)
        turns = np.array(
            [each.name in TURNING for each in self.effects for _ in range(each.count)],
            dtype=np.bool_,
        )
        pattern = usual.causes.pattern[:count]
        programs = Programs(
            self.design,
            self.layout,
            self.target[:count],
            self.usual_u[:count],
            self.usual_scatter.misses_um[self.misses.kind],
            pattern[:, turns],
            (pattern * usual.size)[:, ~turns],
            self.assumed,
        )
        odds = programs.other_names()
        ranked = sorted(odds, key=lambda names: -round(odds[names], DECIMALS))
        if not ranked or odds[ranked[0]] <= -np.log(ODDS):
            return current
        best, every = ranked[0], counts(current.fixed, self.layout)
        others = [*families(current, every), *families_beside(current, self.layout)]
        against = max(0.0, programs.most_odds(others))
        least = max(against, odds[best]) - np.log(ODDS)
        probable = [names for names in ranked if odds[names] > least]
        if not probable:
            return current
        decided = probable == [best] and against <= least
        self.findings.append(name_names(self.layout, probable, decided=decided))
        if not decided or len(set(best)) < len(best):
            return current
        rows = rows_of(self.layout, best)
        deviation_um = self.layout.deviation_um.copy()
        deviation_um[rows] = self.layout.deviation_um
        self.target[:count] += deviation_um - self.layout.deviation_um
        self.layout = replace(self.layout, deviation_um=deviation_um)
        return self._find_scatter(self._fit_with_tilts(), robust=True)

    def _with_right_signs(self, current: MixedFit) -> MixedFit:
        """Reverse the sign of each known angular function that agrees with all other data only with
        the reversed sign, and add a finding. Return the fit."""
        right = sorted(self.angles)
        while wrong := wrong_signs(
            current, {name: self._change_by_sign(name) for name in right}
        ):
            self.target += sum(self._change_by_sign(name) for name in wrong)
            turned = {
                name: replace(self.angles[name], value_urad=-self.angles[name].value_urad)
                for name in wrong
            }
            self.angles = {**self.angles, **turned}
            self.findings += [error("angles-far.sign", name=name) for name in wrong]
            right = [name for name in right if name not in wrong]
            current = self._find_scatter(self._fit_with_tilts(), robust=True)
        # an angular function smaller than its expanded uncertainty does not show its sign
        large = [
            name
            for name in right
            if np.ptp(self.angles[name].value_urad)
            > 2.0 * COVERAGE * np.max(self.angles[name].u_urad)
        ]
        if unseen := unseen_signs(
            current, {name: self._change_by_sign(name) for name in large}
        ):
            self.findings += [info("straightness-unchecked.angles", names=unseen)]
        return current

    def _change_by_sign(self, name: str) -> Vector:
        alone = {name: self.angles[name]}
        beside = [2.0 * of_known_angles(self.design, one, alone) for one in self.straightness]
        change = np.concatenate(
            [2.0 * angular_effect_um(self.layout, self.chain, alone), *beside]
        )
        return np.pad(change, (0, len(self.target) - len(change)))

    def _fit_with_tilts(self) -> MixedFit:
        """Return the fit with the target corrected for the estimated mirror tilts.

        Detected steps of the count are subtracted first: a step of millimetres would cause a tilt
        of milliradians, whose second-order terms are micrometres.
        """
        fixed = fit(self.rows, self.design.blocks, self.target, self._weight())
        found = [effect for effect in self.effects if effect.name in FOUND]
        causes = Causes.of(fixed, self._on_all_rows(found))
        current = MixedFit(fixed, causes, np.ones(causes.pattern.shape[1]))
        for _ in range(TILT_ROUNDS):
            self.target[: len(self.layout)] = self._target_for(
                _smallest_machine(self.design, current)
            )
            current = current.for_target(self.target)
        return self._with_effects(current.fixed)

    def _with_effects(self, fixed: Fit, near: Vector | None = None) -> MixedFit:
        found, self.sizes = self._found(fixed, self.effects, near)
        return found

    def _found(
        self, fixed: Fit, effects: Sequence[Effect], near: Vector | None = None
    ) -> tuple[MixedFit, Sizes]:
        group = np.repeat(np.arange(len(effects)), [effect.count for effect in effects])
        usual = MixedFit(fixed, self._causes(fixed, effects), np.ones(len(group)))
        sought = [
            effect.sought and (self.clean or effect.name in EARLY) for effect in effects
        ]
        sizes = scored(usual, group, np.array(sought, dtype=np.bool_), near)
        return sized(usual, sizes.factor[group]), sizes

    def _causes(self, fixed: Fit, effects: Sequence[Effect]) -> Causes:
        before, those, causes = self.known
        same = (
            causes is not None
            and len(those) == len(effects)
            and all(map(is_, those, effects))
        )
        if causes is None or not same or before is not fixed:
            causes = Causes.of(
                fixed,
                causes.pattern if causes is not None and same else self._on_all_rows(effects),
            )
            self.known = (fixed, tuple(effects), causes)
        return causes

    def _on_all_rows(self, effects: Sequence[Effect]) -> Vector:
        edges = np.cumsum([0, *(effect.count for effect in effects)])
        pattern = np.zeros((len(self.rows), edges[-1]))
        for effect, first, last in zip(effects, edges, edges[1:], strict=False):
            pattern[: len(self.layout), first:last] = effect.pattern_um
            if effect.name in self.beside:
                pattern[len(self.layout) :, first:last] = self.beside[effect.name]
        return pattern

    def _take(self, scatter: Scatter) -> None:
        self.scatter = scatter
        self.u[: len(self.layout)] = scatter.u_um(self.layout)
        self.u[self.misses.rows] = scatter.misses_um[self.misses.kind]

    def _find_scatter(self, current: MixedFit, *, robust: bool) -> MixedFit:
        last = np.zeros_like(self.scatter.log_um)
        for _ in range(ROUNDS):
            before = self.scatter
            found = estimated(
                current, self.layout, self.misses, before, self.usual_scatter, robust=robust
            )
            if found.near(before, self.layout):
                # the fit uses the previous scatter, so the noise of its weights is
                # reported
                self.scatter = replace(
                    before,
                    freedom_misses=found.freedom_misses,
                    freedom_noise=found.freedom_noise,
                )
                break
            last = further(found.log_um - before.log_um, last)
            self._take(before.with_log(before.log_um + last))
            current = self._again(current)
        return self._with_effects(current.fixed)

    def _again(self, current: AnyFit) -> MixedFit:
        return self._with_effects(
            fit(self.rows, self.design.blocks, self.target, self._weight(), current.inverse),
            self.sizes.factor,
        )

    def _target_for(self, unknowns: Vector) -> Vector:
        """Return the deviations corrected for the second-order effects of the estimated tilts,
        shape (m,).

        Mirror and beam tilt together (theory 4.2). Every reading is shorter by nu^2/2 of its
        length. The reading contains the machine errors along the mirror's normal instead of the
        diagonal. The correction changes the deviations, not the rows.
        """
        tilt_mrad = _tilts(self.design, unknowns, len(self.layout.setups))
        self._refuse_impossible(tilt_mrad)
        leaning = self.layout.leaning(tilt_mrad)
        machine = np.where(
            np.arange(len(unknowns)) < self.design.columns.machine, unknowns, 0.0
        )
        seen_more, seen = (
            machine_rows(each, self.chain, self.design.columns).times(machine)
            for each in (leaning, self.layout)
        )
        lean = np.sum(tilt_mrad**2, axis=1)[self.layout.setup_index]
        travel_um = self.layout.since_zero_mm() * 1e3
        known = angular_effect_um(leaning, self.chain, self.angles)
        beside_um = np.sum(tilt_mrad[self.layout.setup_index] * self.layout.beside_mm, axis=1)
        corrected: Vector = (
            self.layout.deviation_um
            + 0.5e-6 * lean * travel_um
            - known
            - (seen_more - seen)
            - beside_um
        )
        return corrected

    def _refuse_impossible(self, tilt_mrad: Vector) -> None:
        size = np.linalg.norm(tilt_mrad, axis=1)
        if not np.all(size <= MOST_TILT_MRAD):
            setup = self.layout.setups[
                int(np.argmax(np.where(np.isnan(size), np.inf, size)))
            ].name
            raise DataError(
                f"{self.layout.source}: setup {setup}",
                expected=message("mirror-explains", most_mrad=MOST_TILT_MRAD),
                found=f"{np.max(size):.3g} mrad",
                remedy=message("not-of-this"),
            )

    def _weight(self) -> Vector:
        weight: Vector = self.kept / self.u**2
        return weight

    def _find_sizes(self, current: MixedFit) -> MixedFit:
        """Increase the assumed sizes of the drift, and of the variation of each reversal with
        position, to the sizes that the data show (variance components)."""
        for _ in range(SIZE_ROUNDS):
            before = self.u.copy()
            for rows in self.sized:
                scale = variance_scale(current, rows) or 1.0
                self.u[rows] = np.maximum(self.u[rows] * scale, self.usual_u[rows])
            if np.all(np.abs(self.u / before - 1.0) < SETTLED):
                break
            current = self._again(current)
        return current

    def _worst(self, current: MixedFit) -> Suspicion | None:
        """Return the contradiction with the highest odds.

        The first search assumes at most the usual size of each effect, so that no large effect
        hides a contradiction. The contradiction of the first search is returned only if it explains
        the readings better than effects with their estimated sizes do. Otherwise a second search
        assumes the estimated sizes.
        """
        every = counts(current.fixed, self.layout)
        as_usual = _as_usual(current, self.effects, self.sizes)
        found = most_suspicious(as_usual, self.design.columns, every)
        if found is None:
            return None
        usual = self._beside(as_usual, found)
        if usual is not None and self._explains(usual, current):
            return usual
        found = most_suspicious(current, self.design.columns, every)
        return None if found is None else self._beside(current, found)

    def _beside(self, fit: MixedFit, found: Suspicion) -> Suspicion | None:
        """Return the contradiction ``found``, or None if a product or a scale explains it nearly
        as well (`solver.adjustment.explanations`)."""
        if found.best.odds <= most_odds_beside(fit, self.layout) + np.log(ODDS):
            return None
        return found

    def _explains(self, suspicion: Suspicion, current: MixedFit) -> bool:
        with_it, _ = self._found(
            current.fixed, [*self.effects, trial_of(self.layout, suspicion)]
        )
        best = suspicion.best
        return bool(
            0.5 * likelier(with_it, current) + max(best.smoother, 0.0) + best.prior
            > np.log(ODDS)
        )

    def _suspicions(self, current: MixedFit) -> Iterator[MixedFit]:
        # so many contradictions are not caused by single wrong stops
        most = max(2, int(len(self.layout) / ODDS))
        for found in range(most + 1):
            suspicion = self._worst(current)
            if suspicion is None:
                return
            if found == most:
                self.findings.append(name_excess(most))
                return
            suspicion = with_apart(
                suspicion, self.design.columns, self.layout.volume, self.chain
            )
            self.kept = weight_without(self.kept / self.u**2, suspicion) * self.u**2
            self.findings.append(name_suspicion(self.layout, suspicion))
            self.effects += effects_for(self.layout, suspicion, self.findings[-1].words)
            current = self._find_scatter(self._fit_with_tilts(), robust=True)
            yield current


def _kinds_of_misses(layout: Layout) -> NDArray[np.int64]:
    row, axis = np.nonzero(layout.arrival >= 0)
    _, at = np.unique(layout.arrival[row, axis], return_index=True)
    begins = np.diff(layout.pass_index, prepend=-1)[row[at]] != 0
    kind: NDArray[np.int64] = np.where(begins, FIRST, axis[at])
    return kind


def _smallest_machine(design: Design, current: AnyFit) -> Vector:
    """Return the unknowns with the smallest machine errors that explain the readings.

    The part of tilts and machine slopes that the readings do not separate is assigned to the tilts,
    which are a thousand times larger.
    """
    null = current.inverse.null
    if not null.shape[1]:
        return current.unknowns
    machine = slice(0, design.columns.machine)
    shift = np.linalg.lstsq(null[machine], -current.unknowns[machine], rcond=None)[0]
    smallest: Vector = current.unknowns + null @ shift
    return smallest


def _tilts(design: Design, unknowns: Vector, setups: int) -> Vector:
    tilts = np.zeros((setups, 3))
    size = unknowns[design.columns.tilt : design.columns.drift]
    np.add.at(
        tilts,
        np.array(design.columns.tilt_setup, dtype=np.int64),
        size[:, None] * design.tilt_direction,
    )
    return tilts
