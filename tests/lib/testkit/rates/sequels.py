"""Is a survey at its end where `stepdiag next` states it? Exact machines with angles of 5 to 50
urad, assumed of 15, driven as it states.

At the end the best further hour is driven as well: the statement is right where it gains less than
the bound that is stated. `benchmarks.designs` prints the table.
"""

from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.names import BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Plan, Run
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import anywhere_mm, rms
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.planning.sequel import Sequel, sequel
from stepdiag.virtual.physics.machine import Machine
from testkit.rates.designs import EMPTY, VOLUME, about, drive, machine_of

SEVEN = replace(
    EMPTY, runs=tuple(Run(setup=name) for name in (*BODY_DIAGONALS, *LINEAR_RUNS))
)
ASSUMED_URAD, RANGE_URAD = 15.0, (5.0, 50.0)
MOST_SETUPS = 24


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A survey at its end: what was stated, and what is left of the machine (um, rms) before and
    after a further hour."""

    angles_urad: float
    setups: int
    stated: Sequel
    now_um: float
    then_um: float

    @property
    def right(self) -> bool:
        """Tell whether the hour gains less than stated."""
        return self.now_um - self.then_um < self.stated.at_most_um


def driven_to_its_end(number: int) -> Ended:
    """Drive a drawn machine as it is stated after each setup."""
    size = float(np.exp(np.random.default_rng((77, number)).uniform(*np.log(RANGE_URAD))))
    machine, job = machine_of(size, 900 + number), about(ASSUMED_URAD)
    plan, done = SEVEN, list[str]()
    ahead = sequel(plan, job, done)
    while not ahead.end and len(done) < MOST_SETUPS:
        plan = _with(plan, ahead.runs[:1])
        done.append(ahead.runs[0].setup)
        readings = drive(_of(plan, done), machine, np.random.default_rng(number))
        ahead = sequel(plan, job, done, readings)
    further = _with(plan, ahead.runs)
    everything = [*done, *(run.setup for run in ahead.runs)]
    now_um, then_um = (
        _left_um(_of(further, names), machine, number) for names in (done, everything)
    )
    return Ended(
        angles_urad=size, setups=len(done), stated=ahead, now_um=now_um, then_um=then_um
    )


def _with(plan: Plan, runs: tuple[Run, ...]) -> Plan:
    planned = {run.setup for run in plan.runs}
    return replace(
        plan, runs=(*plan.runs, *(run for run in runs if run.setup not in planned))
    )


def _of(plan: Plan, names: list[str]) -> Plan:
    return replace(plan, runs=tuple(plan.run_of(name) for name in names))


def _left_um(plan: Plan, machine: Machine, seed: int) -> float:
    points, job = anywhere_mm(VOLUME), about(ASSUMED_URAD)
    result = solve(
        drive(plan, machine, np.random.default_rng(seed)),
        chain=job.chain,
        assumed=job.assumed,
    )
    error = machine.error_at(points) - error_field_um(result, points)
    return rms(np.linalg.norm(without_rigid_motion(VOLUME, points, error), axis=1))


def table(machines: int) -> None:
    """Print every survey, and in how many the statement at the end is right."""
    print("surveys driven as `next` states, to their end; um left, rms over the volume")
    print(
        "| angles | setups | forecast | left | gain of a further hour | stated below "
        "|\n|---|---|---|---|---|---|"
    )
    ended = []
    for number in range(machines):
        one = driven_to_its_end(number)
        ended.append(one)
        gain = f"{one.now_um - one.then_um:.2f} | {one.stated.at_most_um:.2f}"
        print(
            f"| {one.angles_urad:.0f} | {one.setups} | {one.stated.now_um:.2f} | "
            f"{one.now_um:.2f} | {gain} |",
            flush=True,
        )
    print(f"right in {sum(one.right for one in ended)} of {len(ended)}")
