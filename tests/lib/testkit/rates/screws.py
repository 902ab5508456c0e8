"""Is a ball screw of 3 um and 10 mm named by a survey as `init` writes it, and does the machine do
what the result promises?

`benchmarks.designs` prints the count.
"""

from dataclasses import replace

import numpy as np

from stepdiag.base.names import AXES, BODY_DIAGONALS, LINEAR_RUNS
from stepdiag.base.readings.runs import Run
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import rms
from stepdiag.daq.survey.composed import increments_for
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.physics.error_functions import Waved
from stepdiag.virtual.physics.machine import Machine
from testkit.rates.designs import EMPTY, VOLUME, about, drive, machine_of

AMPLITUDE_UM, PITCH_MM, TARGETS = 3.0, 10.0, 40


def screwed(number: int) -> Machine:
    """Return a machine with a wave of the screw's pitch in every axis, of phases of their own."""
    machine, rng = machine_of(10.0, 300 + number), np.random.default_rng(number)
    functions = dict(machine.errors.functions)
    for axis in AXES:
        name = f"E{axis.upper()}{axis.upper()}"
        functions[name] = Waved(
            functions[name], AMPLITUDE_UM, PITCH_MM, float(rng.uniform(0.0, 2.0 * np.pi))
        )
    return replace(machine, errors=replace(machine.errors, functions=functions))


def tried(number: int) -> tuple[bool, bool]:
    """Return whether the wave is named, and whether what is left lies between the ends of what is
    promised."""
    machine, job = screwed(number), about(15.0)
    volume = replace(VOLUME, increments=increments_for(VOLUME.size_mm, PITCH_MM))
    runs = tuple(
        Run(setup=name, targets=TARGETS if name in LINEAR_RUNS else 0)
        for name in (*BODY_DIAGONALS, *LINEAR_RUNS)
    )
    readings = drive(
        replace(EMPTY, volume=volume, runs=runs), machine, np.random.default_rng(number)
    )
    result = solve(
        readings,
        chain=job.chain,
        assumed=replace(job.assumed, between_um=1.5, repeatability_um=0.3),
    )
    named = any(
        found.message is not None and found.message.key == "increments-coarse.hidden"
        for found in result.findings
    )
    points = np.random.default_rng(0).uniform([0.0, 0.0, 0.0], volume.size_mm, (4000, 3))
    error = machine.error_at(points) - error_field_um(result, points)
    left_um = rms(np.linalg.norm(without_rigid_motion(volume, points, error), axis=1))
    promised = result.predicted.without_rigid_motion["after"].rms_um  # type: ignore[union-attr]
    return named, bool(promised.low_um <= left_um <= promised.high_um)


def table(machines: int) -> None:
    """Print how many screws are named, and how many promises are true."""
    found = np.array([tried(number) for number in range(machines)])
    print(
        f"screws of {AMPLITUDE_UM:g} um, pitch {PITCH_MM:g} mm: named {found[:, 0].sum()}, "
        f"promise true {found[:, 1].sum()} of {machines}"
    )
