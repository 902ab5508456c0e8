"""What contradicts the rest of a survey: found, named, and repaired where the readings themselves say what it was.

One pass of each diagonal checks every stop once or not at all, and two passes may share that one check: then the residuals alone
cannot tell which of them is wrong. Smoothness decides where it is decisive; otherwise every explanation is left open as widely as the
contradiction is large, all are named, and nobody may compensate a machine by such a survey.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Argument, Message, Place, message
from stepdiag.base.readings.readings import PassKey
from stepdiag.base.volume import Vector, Volume
from stepdiag.solver.adjustment.counts import Count
from stepdiag.solver.adjustment.hypotheses import LIKELIHOOD_DECIMALS, STOP, Hypothesis, families, shown
from stepdiag.solver.adjustment.smoothness import roughness
from stepdiag.solver.adjustment.wander import Wander, wandering
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.design import Columns
from stepdiag.solver.model.effects import Effect
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.noise import CHECKED
from stepdiag.solver.model.quantities import lattice_field_um, quantities

AS_GOOD = 12.0
"""Two explanations are equally good if their likelihoods differ by less than this (twice the logarithm; p < 0.001)."""
LEAST_SHOWN = 7.0
CRITICAL_OF_BOTH = 30.0
"""What residuals and smoothness must say together for a cause that the residuals alone do not prove: more than `CRITICAL` of one."""
BETTER = 10.0
"""By how much an explanation beats effects larger than usual (twice the logarithm): that its size is free has cost it 15 already, and
both together are five standard deviations, as `CRITICAL` of a survey with a thousand stops."""
MOST = 0.05
"""With more contradictions than this share of the stops, single stops are not the trouble."""
APART_UM = 0.5
"""Explanations whose machines differ by less over the volume (rms) may be left open: whatever is true, the result hardly moves."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Suspicion:
    """A contradiction: what may be the cause, one hypothesis where that is decided; or a pass that wanders, the likeliest first.

    ``smoother``: what the machine's smoothness says for the likeliest (twice the logarithm of the likelihood). ``apart_um``: by how much
    the machines differ over the volume that the explanations make of the readings (rms, the furthest from the likeliest).
    """

    hypotheses: Sequence[Hypothesis] = ()
    wanders: Sequence[Wander] = ()
    smoother: float = 0.0
    apart_um: float = 0.0

    @property
    def decided(self) -> bool:
        """Tell whether the readings say what it was."""
        return len(self.hypotheses) + len(self.wanders) < 2


def most_suspicious(fit: MixedFit, columns: Columns, every: Sequence[Count]) -> Suspicion | None:
    """Return the worst contradiction among the readings, None where all agree within their noise; ``every`` count of theirs."""
    # the misses of the machine take most of what checks a reading: in a small survey no reading alone is checked, and all together are
    if not np.any((fit.redundancy > CHECKED) & (fit.weight > 0)):
        return None
    each = list(families(fit, every))
    found = _likeliest(fit, columns, shown(fit, each, LEAST_SHOWN))
    wanders = wandering(fit, every, max(float(np.sqrt(fit.chi_square / max(fit.freedom, 1))), 1.0))
    if wanders and (found is None or wanders[0].gain > max(one.statistic for one in found.hypotheses) + AS_GOOD):
        return Suspicion(wanders=wanders)
    return found


def _likeliest(fit: MixedFit, columns: Columns, every: Sequence[Hypothesis]) -> Suspicion | None:
    """Return the hypothesis that best explains residuals and roughness together, and all that are as good, the best first."""
    if not every:
        return None
    rough = roughness(columns, np.column_stack([fit.unknowns, *(one.without for one in every)]), fit.inverse.variance())
    smoother = rough[0] - rough[1:]
    likelihood = np.array([one.statistic - one.unusual for one in every]) + smoother
    order = np.argsort(-np.round(likelihood, LIKELIHOOD_DECIMALS), kind="stable")
    best = int(order[0])
    if every[best].statistic < every[best].critical and likelihood[best] < CRITICAL_OF_BOTH:
        return None
    equal = [int(place) for place in order if likelihood[place] > likelihood[best] - AS_GOOD]
    return Suspicion(hypotheses=[every[place] for place in equal], smoother=float(smoother[best]))


def with_apart(suspicion: Suspicion, columns: Columns, volume: Volume, chain: str) -> Suspicion:
    """Return a suspicion with how far its explanations are apart."""
    if suspicion.decided or not suspicion.hypotheses:
        return suspicion
    wanted = quantities(columns, volume)
    apart = np.array([one.without - suspicion.hypotheses[0].without for one in suspicion.hypotheses[1:]])
    off = wanted.combination.times(apart.T)
    field = lattice_field_um(wanted, volume, chain)
    square = np.sum((field @ off) ** 2, axis=(0, 1)) / len(field)
    return replace(suspicion, apart_um=float(np.sqrt(np.max(square))))


def weight_without(weight: Vector, suspicion: Suspicion) -> Vector:
    """Return the weights without the one wrong stop, or with every possible one as uncertain as the contradiction is large."""
    lowered = weight.copy()
    for one in suspicion.hypotheses:
        if one.kind == STOP:
            lowered[one.named] = 0.0 if suspicion.decided else 1.0 / (1.0 / weight[one.named] + one.size**2)
    return lowered


def effects_for(layout: Layout, suspicion: Suspicion) -> list[Effect]:
    """Return what the adjustment has to leave open from now on: a decided cause entirely, a possible one by its size."""
    text = name_suspicion(layout, suspicion).words
    if suspicion.wanders:
        patterns = [wander.pattern(len(layout)) for wander in suspicion.wanders]
        return [Effect(name="wandering pass", text=text, pattern_um=np.hstack(patterns))]
    found = [one for one in suspicion.hypotheses if one.kind != STOP]
    sizes = [one.free if suspicion.decided else abs(one.size) for one in found]
    return [
        Effect(name=f"found {one.kind}", text=text, pattern_um=size * one.on(len(layout))[:, None])
        for one, size in zip(found, sizes, strict=True)
    ]


def trial_of(layout: Layout, suspicion: Suspicion) -> Effect:
    """Return the likeliest explanation as an effect of which nothing is known beforehand."""
    if suspicion.wanders:
        return effects_for(layout, replace(suspicion, wanders=suspicion.wanders[:1]))[0]
    best = suspicion.hypotheses[0]
    return Effect(name="suspicion", text="", pattern_um=best.free * best.on(len(layout))[:, None])


def name_suspicion(layout: Layout, suspicion: Suspicion) -> Finding:
    """Return the finding that names what was found."""
    if suspicion.wanders:
        return _name_wander(layout, suspicion.wanders)
    if suspicion.decided:
        return _name_decided(layout, suspicion.hypotheses[0])
    kinds = {one.kind for one in suspicion.hypotheses}
    suspects, among = [_suspect(layout, one) for one in suspicion.hypotheses], _among(layout, suspicion.hypotheses)
    if kinds == {STOP}:
        if suspicion.apart_um > APART_UM:
            return finding("error", message("contradiction-ambiguous.apart", suspects=suspects, apart_um=suspicion.apart_um), among=among)
        return finding("warning", message("contradiction-ambiguous.stop", suspects=suspects))
    return finding("error", message("contradiction-ambiguous", suspects=suspects), among=among)


def _among(layout: Layout, every: Sequence[Hypothesis]) -> tuple[str, ...]:
    """Return the passes that explanations are about."""
    named = {layout.passes[int(layout.pass_index[one.named])] for one in every}
    return tuple(key.place for key in layout.passes if key in named)


def _name_decided(layout: Layout, one: Hypothesis) -> Finding:
    key = layout.passes[int(layout.pass_index[one.named])]
    place = Place(setup=key.setup, pass_number=key.number, stop=int(layout.stop[one.named]))
    words = message("stop-outlier" if one.kind == STOP else "count-step", place=layout.place(one.named), size_um=one.size)
    return finding("warning", words, place, size_um=one.size)


def _suspect(layout: Layout, one: Hypothesis) -> Message:
    return message("suspect-stop" if one.kind == STOP else "suspect-step", place=layout.place(one.named), size_um=one.size)


def _name_wander(layout: Layout, wanders: Sequence[Wander]) -> Finding:
    """Return the finding on a pass that wanders: another drive of the same setup outweighs it, else the survey is not to be used."""
    if len(wanders) > 1:
        suspects = [message("suspect-pass", **_of_pass(layout, wander)) for wander in wanders]
        return finding("error", message("pass-wanders.which", suspects=suspects), among=_passes_of(layout, wanders))
    setup = layout.setups[int(layout.setup_index[wanders[0].rows[0]])].name
    about = _of_pass(layout, wanders[0])
    if _driven_again(layout, wanders[0].rows):
        return finding("warning", message("pass-wanders.driven-again", setup=setup, **about))
    return finding("error", message("pass-wanders", setup=setup, **about), among=_passes_of(layout, wanders))


def _passes_of(layout: Layout, wanders: Sequence[Wander]) -> tuple[str, ...]:
    rows = np.concatenate([wander.rows for wander in wanders])
    return tuple(layout.passes[int(number)].place for number in np.unique(layout.pass_index[rows]))


def _of_pass(layout: Layout, wander: Wander) -> dict[str, Argument]:
    """Return the arguments of a pass that wanders."""
    first, last = (int(layout.stop[wander.rows[place]]) for place in (0, -1))
    passes = [layout.passes[int(number)].words for number in dict.fromkeys(layout.pass_index[wander.rows])]
    return {"passes": passes, "first": first, "last": last, "size_um": wander.step_um * float(np.sqrt(len(wander.rows) - 1))}


def _driven_again(layout: Layout, rows: NDArray[np.int64]) -> bool:
    """Tell whether the setup has another pass in the same direction on another count."""
    mine: set[PassKey] = {layout.passes[int(number)] for number in layout.pass_index[rows]}
    others = [key for key in layout.passes if key not in mine]
    return all(any(key.setup == other.setup and key.outward == other.outward for other in others) for key in mine)


def name_excess(count: int) -> Finding:
    """Return the finding for more contradictions than single wrong stops explain."""
    return finding("error", message("too-many-outliers", count=count))
