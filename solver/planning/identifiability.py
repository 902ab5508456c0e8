"""The quantities that a survey does not identify, and the runs of least time that would identify
them.

Identifiability depends on setups and beam lines, not on the number of increments (theory 5.1: no
difference for n = 1 .. 20). A few increments are therefore enough, and the computation takes
milliseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Plan, Run, perfect_readings, run_minutes
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.setups import FACE_DIAGONALS
from stepdiag.base.volume import Vector
from stepdiag.solver.linear.least_squares import NULL_TOLERANCE, Inverse, invert
from stepdiag.solver.model.design import Design, Model, build_design
from stepdiag.solver.model.layout import Layout, lay_out
from stepdiag.solver.model.priors import make_prior
from stepdiag.solver.model.quantities import Quantities, quantities
from stepdiag.solver.model.reported import reported, shape

COARSE = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """Additional runs that identify the missing quantities, and their minutes with usual set-up
    times."""

    runs: tuple[Run, ...]
    minutes: float


def cheapest_runs(
    layout: Layout, chain: str, model: Model, missing: Sequence[str]
) -> Advice | None:
    """Return the additional runs that identify all quantities of ``missing`` (names of `reported`),
    or None if no usual run helps.

    Runs are chosen one by one: the run that identifies most quantities per minute. If no run
    identifies a quantity, the run that determines most combinations of the unknowns is chosen.
    """
    survey = _coarse(layout)
    design = build_design(
        lay_out(perfect_readings(survey), layout.source, survey.volume),
        chain,
        replace(model, lines=0),
    )
    null = np.linalg.qr(_seen(design).null)[0]
    found = reported(design)
    asked = found.select(np.concatenate([found.of(name) for name in missing]))
    candidates = {run: _Candidate.of(run, design, model) for run in _usual_runs(model)}
    chosen = _choose(asked, null, candidates)
    full = Plan(volume=layout.volume, runs=())
    return (
        None
        if chosen is None
        else Advice(runs=chosen, minutes=sum(run_minutes(full, run) for run in chosen))
    )


def resolved_angles(layout: Layout, chain: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the angular functions whose shape the readings determine without an assumption about
    their size (theory 5.2). A survey with one beam line for each setup determines no angular
    function in this way."""
    if not names or all(setup.shift == 0 for setup in layout.setups):
        return ()
    survey = _coarse(layout)
    coarse = lay_out(perfect_readings(survey), layout.source, survey.volume)
    design = build_design(
        coarse,
        chain,
        Model(angles=True, reversal=any(run.return_pass for run in survey.runs)),
    )
    found = reported(design)
    seen = _seen(design).sees(found.combination)
    return tuple(name for name in names if bool(np.all(seen[found.of(shape(name))])))


class Seen(NamedTuple):
    """The quantities that a survey determines without assumptions about angles, and the number
    of combinations of the unknowns that the survey does not determine."""

    known: dict[str, bool]
    hidden: int


def identified_with_angles(layout: Layout, chain: str) -> Seen:
    """Return the quantities that a survey determines if all 18 functions are unknown."""
    design = build_design(layout, chain, Model(angles=True))
    inverse = _seen(design)
    found = quantities(design.columns, design.volume)
    seen = inverse.sees(found.combination)
    known = {name: bool(np.all(seen[found.of(name)])) for name in found.groups}
    return Seen({**dict.fromkeys(DISPLACEMENTS, True), **known}, inverse.null.shape[1])


def _seen(design: Design) -> Inverse:
    prior = make_prior(design, {}, free_angles=True)
    rows = design.rows.followed_by(prior.rows)
    return invert(rows, np.ones(len(rows)), design.blocks)


def _coarse(layout: Layout) -> Plan:
    runs = []
    for index, setup in enumerate(layout.setups):
        row = int(np.argmax(layout.setup_index == index))
        numbers = [key.number for key in layout.passes if key.setup == setup.name]
        beam = layout.beam_mm[row] - layout.position_mm[row]
        across = beam - layout.direction[row] * float(beam @ layout.direction[row])
        x, y, z = (float(round(value, 6)) for value in across)
        runs.append(
            Run(
                setup=setup.name,
                return_pass=any(number % 2 == 0 for number in numbers),
                beam_offset_mm=(x, y, z),
            )
        )
    return Plan(
        volume=replace(layout.volume, increments=min(COARSE, layout.volume.increments)),
        runs=tuple(runs),
    )


def _choose(
    asked: Quantities, null: Vector, candidates: dict[Run, "_Candidate"]
) -> tuple[Run, ...] | None:
    chosen: list[Run] = []
    hidden = _hidden(asked, null)
    while hidden:
        left = {
            run: candidate.narrow(null)
            for run, candidate in candidates.items()
            if run not in chosen
        }
        gain = {
            run: (hidden - _hidden(asked, rest), null.shape[1] - rest.shape[1])
            for run, rest in left.items()
        }
        best = max(
            gain,
            key=lambda run: tuple(one / candidates[run].minutes for one in gain[run]),
            default=None,
        )
        if best is None or not any(gain[best]):
            return None
        null, hidden = left[best], hidden - gain[best][0]
        chosen.append(best)
    return tuple(chosen)


def _hidden(missing: Quantities, null: Vector) -> int:
    if not null.shape[1]:
        return 0
    largest = max(float(np.max(np.abs(missing.combination.value))), 1.0)
    return int(np.linalg.matrix_rank(missing.combination.times(null), tol=1e-6 * largest))


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    minutes: float
    machine: Vector
    nuisance: Vector

    @classmethod
    def of(cls, run: Run, design: Design, model: Model) -> "_Candidate":
        plan = Plan(volume=design.volume, runs=(run,))
        layout = lay_out(perfect_readings(plan), "advice", design.volume)
        own = build_design(layout, design.chain, replace(model, lines=0))
        rows = own.rows.dense()
        machine = np.zeros((len(rows), design.columns.count))
        machine[:, : own.columns.machine] = rows[:, : own.columns.machine]
        return cls(run_minutes(plan, run), machine, rows[:, own.columns.machine :])

    def narrow(self, null: Vector) -> Vector:
        """Return the part of a null space that is still not determined after this run."""
        seen = np.hstack([self.machine @ null, self.nuisance])
        scale = np.linalg.norm(seen, axis=0)
        scale = np.where(scale > NULL_TOLERANCE, scale, 1.0)
        _, size, right = np.linalg.svd(seen / scale, full_matrices=True)
        free = right[int(np.count_nonzero(size > NULL_TOLERANCE)) :].T / scale[:, None]
        left: Vector = null @ free[: null.shape[1]]
        keep, size, _ = np.linalg.svd(left, full_matrices=False)
        narrowed: Vector = keep[:, size > NULL_TOLERANCE * size.max(initial=1.0)]
        return narrowed


def _usual_runs(model: Model) -> Sequence[Run]:
    return [
        Run(setup=name, return_pass=model.reversal)
        for name in (*LINEAR_RUNS, *BODY_DIAGONALS, *FACE_DIAGONALS)
    ]
