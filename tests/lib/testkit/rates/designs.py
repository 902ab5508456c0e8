"""Do surveys that the planner proposes leave of exact machines what it says, and is any other
choice of lines better?

Machine and laser are the virtual ones, which share no code with the solver; they are driven to the
stops of the plan, on whatever line. `benchmarks.designs` and `benchmarks.honesty` print the table.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.names import LINEAR_RUNS
from stepdiag.base.readings.readings import Readings
from stepdiag.base.readings.runs import Pace, Plan, Run, perfect_readings, plan_minutes
from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.base.volume import Volume, anywhere_mm, rms
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.planning.circumstances import Circumstances
from stepdiag.solver.planning.foresight import bent_um
from stepdiag.solver.planning.planner import forecast
from stepdiag.solver.planning.search import Search
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.exact.placed import placed

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
EMPTY = Plan(volume=VOLUME, runs=())
NOISE_UM, NOISE_OVER_S, TILT_MRAD = 0.3, 2.0, 0.3
"""Noise of a reading that is the mean over so many seconds; it falls with the root of the dwell."""
MACHINES = 20
ARRIVAL_UM, DRIFT_UM, WANDER_UM = 0.5, 0.15, 0.1
"""Of a machine that scatters: of each arrival of an axis, and of a pass."""
ALIGNING_MIN = 1000.0


def machine_of(range_urad: float, seed: int) -> Machine:
    """Return a machine: straightness and positioning up to 9 um, scales up to 20 um/m, squareness
    20 urad."""
    wanted = Amplitudes(
        positioning_um=9.0,
        straightness_um=9.0,
        angle_urad=range_urad,
        scale_um_m=20.0,
        squareness_urad=20.0,
    )
    return Machine(
        errors=random_errors(seed, VOLUME.origin_mm, VOLUME.size_mm, wanted), chain="FXYZ"
    )


def drive(survey: Plan, machine: Machine, rng: np.random.Generator) -> Readings:
    """Return the readings of a survey: mirror and beam of every setup lean in directions of their
    own."""
    noise_um = NOISE_UM * float(np.sqrt(NOISE_OVER_S / survey.pace.dwell_s))
    readings = perfect_readings(survey, noise_um)
    read_mm = np.array(readings.reading_mm)
    for run in survey.runs:
        leans = [
            TILT_MRAD * np.array([np.cos(turn), np.sin(turn)])
            for turn in rng.uniform(0, 2 * np.pi, 2)
        ]
        mirror, beam = ((float(a), float(b)) for a, b in leans)
        setup = placed(survey, run, mirror, beam)
        for key, rows in readings.passes().items():
            if key.setup == run.setup:
                stops = readings.position_mm[rows]
                shown = machine.indicated_mm(
                    setup,
                    stops,
                    direction=np.sign(stops[-1] - stops[0]),
                    time_s=np.zeros(len(stops)),
                )
                noisy = shown + rng.normal(scale=1e-3 * noise_um, size=len(rows))
                read_mm[rows] = noisy - noisy[0]
    object.__setattr__(readings, "reading_mm", read_mm)
    return readings


def scattered(readings: Readings, survey: Plan, rng: np.random.Generator) -> Readings:
    """Return readings with what the axes miss their targets by, each until it moves again, and the
    drift and the wander of each pass."""
    read_mm = np.array(readings.reading_mm)
    for key, rows in readings.passes().items():
        stops, along = (
            readings.position_mm[rows],
            np.array(survey.run_of(key.setup).travel.signs) * np.array(survey.volume.size_mm),
        )
        misses = [rng.normal(scale=ARRIVAL_UM, size=3)]
        for moved in np.abs(np.diff(stops, axis=0)) > 0.0:
            misses.append(np.where(moved, rng.normal(scale=ARRIVAL_UM, size=3), misses[-1]))
        drift = np.cumsum(rng.normal(scale=WANDER_UM / np.sqrt(len(rows)), size=len(rows)))
        drift += DRIFT_UM * rng.normal() * np.linspace(0, 1, len(rows))
        added = np.array(misses) @ (along / np.linalg.norm(along)) + drift
        read_mm[rows] += 1e-3 * (added - added[0])
    object.__setattr__(readings, "reading_mm", read_mm)
    return readings


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What is left of each machine (um, rms over the volume, rigid motion removed), and what was
    forecast for such machines."""

    plan: Plan
    forecast_um: float
    left_um: Sequence[float]

    @property
    def rms_um(self) -> float:
        """Return the root mean square over the machines."""
        return rms(np.array(self.left_um))


def about(range_urad: float) -> Circumstances:
    """Return the circumstances of a machine that comes back exactly, without a head."""
    assumed = Assumptions(
        angles_urad=range_urad,
        alignment_mrad=0.1,
        reading_um=NOISE_UM,
        repeatability_um=0.0,
        growth_um_m=0.0,
        between_um=0.0,
        drift_um=0.0,
        wander_um=0.0,
        index=0.0,
        index_setup=0.0,
        setup_c=0.0,
    )
    return Circumstances(head=False, assumed=assumed)


def driven(
    survey: Plan, range_urad: float, machines: int, seed: int = 0, *, scatters: bool = False
) -> Driven:
    """Drive a survey on drawn machines and solve it."""
    job = about(range_urad)
    if scatters:
        job = replace(
            job,
            assumed=replace(
                job.assumed,
                repeatability_um=ARRIVAL_UM,
                drift_um=DRIFT_UM,
                wander_um=WANDER_UM,
            ),
        )
    points = anywhere_mm(VOLUME)
    left = []
    for number in range(machines):
        machine = machine_of(range_urad, seed + number)
        rng = np.random.default_rng((seed, number))
        readings = drive(survey, machine, rng)
        result = solve(
            scattered(readings, survey, rng) if scatters else readings,
            chain=job.chain,
            assumed=job.assumed,
        )
        error = machine.error_at(points) - error_field_um(result, points)
        left.append(rms(np.linalg.norm(without_rigid_motion(VOLUME, points, error), axis=1)))
    ahead = forecast(survey, job).ahead
    # the sizes are those that are assumed: nothing of the forecast's other sizes
    expected = float(np.hypot(ahead.full[0], bent_um(job.assumed, survey.volume.increments)))
    return Driven(plan=survey, forecast_um=expected, left_um=left)


def within(range_urad: float, minutes: float) -> Plan:
    """Return what the planner proposes for a time."""
    return _found(Search(EMPTY, about(range_urad)), minutes)


def with_lines(range_urad: float, lines: int) -> Plan:
    """Return what the planner proposes for so many alignments, each as dear as the others."""
    dear = Pace(
        diagonal_setup_min=ALIGNING_MIN,
        linear_setup_min=ALIGNING_MIN,
        beam_shift_min=ALIGNING_MIN,
    )
    return _found(
        Search(replace(EMPTY, pace=dear), about(range_urad)), (lines + 0.9) * ALIGNING_MIN
    )


def _found(search: Search, minutes: float) -> Plan:
    survey = search.within(minutes)
    if survey is None:
        raise ValueError(f"nothing fits into {minutes:g} min")
    return survey


CASES: Sequence[tuple[str, float, Callable[[float], Plan], float]] = (
    ("240 minutes", 30.0, lambda size: within(size, 240.0), 1.3),
    ("157 minutes", 10.0, lambda size: within(size, 157.0), 1.8),
    *(
        (f"{lines} alignments", 20.0, lambda size, lines=lines: with_lines(size, lines), most)
        for lines, most in ((7, 1.1), (9, 0.9), (11, 0.75))
    ),
)
"""Name, range of the angles in urad, the survey, and what it is to leave at most in um."""


def table(machines: int) -> None:
    """Print what is left of machines beside what was forecast and what is asked for."""
    print(
        f"surveys of the planner on {machines} exact machines each: um left, rms over machines "
        "and volume"
    )
    print(
        "| survey | angles | lines | min | left | forecast | at most "
        "|\n|---|---|---|---|---|---|---|"
    )
    for name, size, survey_of, most in CASES:
        survey = survey_of(size)
        found = driven(survey, size, machines, seed=900)
        minutes = plan_minutes(replace(survey, pace=Pace(dwell_s=survey.pace.dwell_s)))
        left = f"{found.rms_um:.2f} | {found.forecast_um:.2f} | {most:g}"
        print(
            f"| {name} | {size:g} | {len(survey.runs)} | {minutes:.0f} | {left} |", flush=True
        )
    for back in (False, True):
        survey = replace(
            EMPTY,
            runs=tuple(
                Run(setup=name, return_pass=back)
                for name in ("ppp", "npp", "pnp", *LINEAR_RUNS)
            ),
        )
        found = driven(survey, 15.0, 2 * machines, seed=700, scatters=True)
        left = f"{found.rms_um:.2f} | {found.forecast_um:.2f}"
        print(
            f"| six, scattering, {'out and back' if back else 'one way'} | 15 | 6 | "
            f"{plan_minutes(survey):.0f} | {left} | |",
            flush=True,
        )
