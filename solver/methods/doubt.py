"""The finding about a probable error in the readings: its candidates, their effects on the
volume, and the setup whose repetition identifies the true candidate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.base.findings import Finding, finding
from stepdiag.base.messages import Message, message
from stepdiag.base.readings.runs import Plan, Run, run_minutes
from stepdiag.base.setups import Setup
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.adjustment import Adjustment
from stepdiag.solver.adjustment.diagnostics import scale_findings
from stepdiag.solver.adjustment.evidence import DECIMALS, PRODUCT, SCALE
from stepdiag.solver.adjustment.naming import suspect
from stepdiag.solver.linear.components import sized
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.model.effects import BESIDE, GROWTH, ONE_SCALE, ONE_WALK, SETUP_SCALE
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.uncertainty.machine import Machine, free_fields_um, machine_of

ALONE = 100.0
"""Factor on the standard deviation of an explanation that makes its size practically free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A possible error of a survey: its probability ``share``, its description ``words``, its
    passes, its random effect, and the columns ``causes`` of this effect."""

    share: float
    words: Message
    passes: tuple[str, ...] = ()
    effect: str
    causes: slice


def doubt_findings(found: Adjustment) -> list[Finding]:
    """Return the finding about an error with several explanations: the candidates, the most
    probable first, the effect of each on the volume, and the setup whose repetition decides.

    Growth alone is no reason for this finding, because every machine grows. If the candidates have
    more than half of the probability only together with growth, the finding is returned only if
    compensation would increase the error under one of the candidates. If the lengths contradict
    each other, `scale_findings` lists the candidates instead.
    """
    setups = found.explained.unnamed
    if not (setups or found.explained.unnamed_with_growth) or scale_findings(found):
        return []
    every, volume = (
        sorted(candidates(found), key=lambda one: -round(one.share, DECIMALS)),
        Volumes.of(found),
    )
    if len(every) < 2 or not (setups or any(volume.harmed_by(one) for one in every)):
        return []
    suspects = [
        message(
            "suspect-of-volume", suspect=one.words, volume_um=rms_um(volume.apart_um(one))
        )
        for one in every
    ]
    among = {place for one in every for place in one.passes}
    setup, minutes = separating(found.layout, every)
    words = message(
        "contradiction-ambiguous.open", suspects=suspects, setup=setup, minutes=minutes
    )
    return [
        finding(
            "warning",
            words,
            among=tuple(one.place for one in found.layout.passes if one.place in among),
        )
    ]


def candidates(found: Adjustment) -> list[Candidate]:
    """Return every probable error: errors outside the model, and unusual growth."""
    explained, layout = found.explained, found.layout
    every = [
        Candidate(
            share=explained.growth,
            words=message("suspect-growth"),
            effect=GROWTH,
            causes=slice(None),
        )
    ]
    for kind, effect in ((SCALE, ONE_SCALE), (PRODUCT, BESIDE)):
        for place, at in enumerate(explained.of(kind)):
            name = layout.setups[explained.named[at]].name if kind != PRODUCT else ""
            every.append(
                Candidate(
                    share=float(explained.share[at]),
                    words=suspect(layout, explained, int(at)),
                    passes=tuple(key.place for key in layout.passes if key.setup == name),
                    effect=effect,
                    causes=slice(place, place + 1),
                )
            )
    return [one for one in every if one.share > 0.0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Volumes:
    """Error vectors over the volume without rigid motion: ``fields`` (k, 3 points) are the
    vectors for one unit of each value of ``machine``."""

    found: Adjustment
    machine: Machine
    fields: Vector

    @classmethod
    def of(cls, found: Adjustment) -> "Volumes":
        first = found.first_cause("angles") if found.shapes.names else 0
        machine = machine_of(
            found.design, found.shapes, first, len(found.fit.size), found.products
        )
        return cls(
            found=found,
            machine=machine,
            fields=free_fields_um(machine, found.layout.volume, found.design.chain),
        )

    @property
    def reported_um(self) -> Vector:
        """Return the reported error vectors, shape (3 points,)."""
        return self._over_volume(self.found.fit)

    def apart_um(self, one: Candidate) -> Vector:
        """Return the error vectors of the machine minus the reported error vectors if one
        explanation is true, shape (3 points,)."""
        return self._over_volume(_alone(self.found, one)) - self.reported_um

    def harmed_by(self, one: Candidate) -> bool:
        """Return whether compensation of the reported errors increases the machine's error if
        one explanation is true."""
        left = self.apart_um(one)
        return rms_um(left) > rms_um(left + self.reported_um)

    def _over_volume(self, fit: MixedFit) -> Vector:
        value = (
            self.machine.combination.times(fit.unknowns) + self.machine.on_causes @ fit.amount
        )
        over: Vector = value @ self.fields
        return over


def rms_um(field_um: Vector) -> float:
    """Return the root mean square length of error vectors (3 points,)."""
    return float(np.sqrt(3.0 * np.mean(field_um**2)))


def _alone(found: Adjustment, one: Candidate) -> MixedFit:
    factors = []
    for effect, size in zip(found.effects, found.sizes.factor.tolist(), strict=True):
        usual = min(1.0, 1.0 / size) if effect.name in (GROWTH, SETUP_SCALE) else 1.0
        factor = np.full(
            effect.count, 0.0 if effect.name in (ONE_SCALE, ONE_WALK, BESIDE) else usual
        )
        if effect.name == one.effect:
            factor[one.causes] = 1.0 if effect.name == GROWTH else ALONE
        factors.append(factor)
    return sized(found.fit, np.concatenate(factors))


def separating(layout: Layout, every: Sequence[Candidate]) -> tuple[str, float]:
    """Return the best setup to drive again, and its minutes. The best setup has the largest p (1 -
    p) per minute, with p the probability that its passes contain the cause. The minutes include
    setting up laser and target."""
    found = []
    for setup in layout.setups:
        share = sum(
            one.share
            for one in every
            if any(place.startswith(f"{setup.name}/") for place in one.passes)
        )
        minutes = minutes_of(layout, setup)
        found.append((round(share * (1.0 - share) / minutes, DECIMALS), setup.name, minutes))
    _, name, minutes = max(found, key=lambda one: one[0])
    return name, minutes


def minutes_of(layout: Layout, setup: Setup) -> float:
    """Return the minutes of all passes of a setup, with usual times for set-up and moves."""
    mine = [key for key in layout.passes if key.setup == setup.name]
    both = len({key.outward for key in mine}) > 1
    run = Run(
        setup=setup.name, repeats=max(len(mine) // (2 if both else 1), 1), return_pass=both
    )
    return run_minutes(Plan(volume=layout.volume, runs=(run,)), run)
