"""``python -m benchmarks.honesty``: does what the solver says of itself hold, against exact
machines that share no code with it?

For every class of machine: the share of true values within 2 u by class of quantity, and of true
volumetric errors (as it stands, and after a compensation with everything that was found, anywhere
in the volume) within the predicted interval; how wide that is beside what 95 % would have needed;
and the rms that is left, beside that of an independent exact least squares that is told the true
sizes (`benchmarks.exact`). Sizes were tried on seeds 600 to 623; the table's seeds begin at 900.
``--mixed N`` draws N machines over all classes together instead: a class by itself cannot tell an
interval that is too wide from one that must hold its other classes too.

``--false-alarms N`` prints how often good surveys are refused, N of the solver's stated assumptions
and N of ordinary machines and shops (`benchmarks.false_alarms`); without options this table follows
the other one, and what `trend` and `compare` report of machines over years (`benchmarks.fates`)
follows both, and the 4-DOF heads (`benchmarks.heads`) and the proof runs (`benchmarks.proofs`) come
last. ``--explained N`` prints what becomes of surveys with one thing wrong, and of machines beside
the model (`benchmarks.explained`).
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import explained, false_alarms
from benchmarks.exact import ExactModel, left_um
from benchmarks.told import Told, within
from stepdiag.base.readings.readings import Readings, make_readings
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.interval import When
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import DISPLACEMENTS
from stepdiag.base.result.typed import written
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import (
    Amplitudes,
    ErrorFunction,
    ErrorSet,
    random_errors,
)
from stepdiag.virtual.physics.machine import Machine
from testkit.ordinary.arrivals import Scatter
from testkit.ordinary.measured import Conditions, simulate_pass

SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
BOX = Box(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
NOISE_UM = {"linear": 0.2, "diagonal": 0.3}
REPEATABILITY_UM = 0.5
"""Of each move of an axis, along it: an ordinary machine (`testkit.ordinary.machines`)."""
TILT_MRAD = 0.5


@dataclass(frozen=True, kw_only=True)
class Case:
    """A class of machine: range of its angular functions (the solver assumes 10 urad), chain,
    drift, backlash, warming, and full waves of 2 um an axis in every displacement function; and
    which setups its survey has."""

    name: str
    angle_urad: float = 0.0
    chain: str = "FXYZ"
    drift_um_h: float = 0.0
    backlash_um: float = 0.0
    warming_c_h: float = 0.0
    waves: int = 0
    passes: Sequence[int] = (1,)
    setups: Sequence[str] = SETUPS
    increments: int = BOX.increments
    repeatability_um: float = REPEATABILITY_UM

    @property
    def box(self) -> Box:
        """Return the volume with the class's targets."""
        return replace(BOX, increments=self.increments)

    @property
    def bounded(self) -> bool:
        """Tell whether the exact least squares knows such machines, and has all it needs."""
        return self.setups == SETUPS and not (
            self.drift_um_h or self.backlash_um or self.warming_c_h or self.waves
        )


CASES = (
    *(
        Case(name=f"{size:g} urad, {chain}", angle_urad=size, chain=chain)
        for chain in ("FXYZ", "XYFZ")
        for size in (0, 2, 5, 10, 20, 50)
    ),
    Case(name="10 urad, XFYZ", angle_urad=10, chain="XFYZ"),
    Case(name="10 urad, XYZF", angle_urad=10, chain="XYZF"),
    Case(name="10 urad, drift 2 um/h", angle_urad=10, drift_um_h=2.0),
    Case(
        name="5 urad, backlash 4 um, out and back",
        angle_urad=5,
        backlash_um=4.0,
        passes=(1, 2),
    ),
    Case(name="5 urad, 0.1 C/h", angle_urad=5, warming_c_h=0.1),
    *(
        Case(name=f"5 urad, {count} waves an axis", angle_urad=5, waves=count)
        for count in (3, 4, 6)
    ),
    Case(name="10 urad, four diagonals alone", angle_urad=10, setups=SETUPS[:4]),
    Case(name="10 urad, four diagonals and X", angle_urad=10, setups=SETUPS[:5]),
    Case(
        name="10 urad, three diagonals and runs",
        angle_urad=10,
        setups=(*SETUPS[:3], *SETUPS[4:]),
    ),
    Case(name="10 urad, four increments", angle_urad=10, increments=4),
    Case(name="5 urad, twenty increments", angle_urad=5, increments=20),
    Case(name="10 urad, linear runs alone", angle_urad=10, setups=SETUPS[4:]),
    Case(name="10 urad, one diagonal", angle_urad=10, setups=SETUPS[:1]),
)
FIRST_SEED = 900
WAVE_UM = 2.0
POINTS = 500
MIXED_URAD = 30.0
CHAINS = ("FXYZ", "XYFZ", "XFYZ", "XYZF")
MIXED_WAVES = (0, 0, 0, 2, 3, 4, 6)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What one survey showed; ``bound_um`` is what the exact least squares leaves, NaN where it
    does not know the class."""

    within: dict[str, list[bool]]
    before: Told
    after: Told
    bound_um: float


def drawn_case(seed: int) -> Case:
    """Return a class of its own: any chain, angles to 30 urad; half drift (to 2 um/h), half have
    backlash (to 6 um), some have waves."""
    rng = np.random.default_rng((77, seed))
    angle_urad, chain = float(rng.uniform(0.0, MIXED_URAD)), str(rng.choice(CHAINS))
    drift_um_h = float(rng.uniform(0.0, 2.0)) if rng.random() < 0.5 else 0.0
    backlash_um = float(rng.uniform(0.0, 6.0)) if rng.random() < 0.5 else 0.0
    return Case(
        name=f"drawn {seed}",
        angle_urad=angle_urad,
        chain=chain,
        drift_um_h=drift_um_h,
        backlash_um=backlash_um,
        passes=(1, 2) if backlash_um else (1,),
        waves=int(rng.choice(MIXED_WAVES)),
    )


def machine_of(case: Case, seed: int) -> Machine:
    """Return a drawn machine: 9 um of positioning and straightness, scales to 20 um/m, squareness
    20 urad."""
    wanted = Amplitudes(
        positioning_um=9.0, straightness_um=9.0, angle_urad=case.angle_urad, scale_um_m=20.0
    )
    drawn = random_errors(seed, BOX.origin_mm, BOX.size_mm, wanted)
    functions = {name: _waved(one, name, case, seed) for name, one in drawn.functions.items()}
    lost = (
        {
            f"E{axis}{axis}": (lambda at, um=case.backlash_um: np.full_like(at, -um))
            for axis in "XYZ"
        }
        if case.backlash_um
        else {}
    )
    errors = ErrorSet(
        low_mm=drawn.low_mm,
        size_mm=drawn.size_mm,
        functions=functions,
        squareness_urad=drawn.squareness_urad,
        reversal=lost,
    )
    drift = tuple(
        float(one)
        for one in case.drift_um_h * np.random.default_rng(seed).choice([-1.0, 1.0], 3)
    )
    hall = Environment(material_c=Course(start=20.0, per_hour=case.warming_c_h))
    return Machine(
        errors=errors,
        chain=case.chain,
        drift_um_h=drift,  # type: ignore[arg-type]
        expansion_um_m_c=(11.7,) * 3,
        environment=hall,
    )


def drive(case: Case, machine: Machine, seed: int) -> Readings:
    """Return the readings of the class's setups, mirror and beam leaning half a milliradian."""
    rng = np.random.default_rng(1000 + seed)
    parts, start_s = [], 0.0
    for setup in case.setups:
        linear = setup.startswith("linear")
        mirror, beam = (
            tuple(TILT_MRAD * np.array([np.cos(turn), np.sin(turn)]))
            for turn in rng.uniform(0, 2 * np.pi, 2)
        )
        how = Alignment(mirror_mrad=mirror, beam_mrad=(0.0, 0.0) if linear else beam)
        noise = NOISE_UM["linear" if linear else "diagonal"]
        for number in case.passes:
            scatter = Scatter(arrival_um=(case.repeatability_um,) * 3)
            taken = Conditions(
                noise_um=noise,
                seed=int(rng.integers(1 << 31)),
                start_s=start_s,
                scatter=scatter,
            )
            one = simulate_pass(
                machine, case.box, setup, number, alignment=how, conditions=taken
            )
            parts.append((setup, number, one, noise))
            start_s = float(one.time_s[-1]) + 600.0
    return make_readings(
        setup=[setup for setup, _, one, _ in parts for _ in one.stop],
        pass_number=[number for _, number, one, _ in parts for _ in one.stop],
        u_um=[noise for *_, one, noise in parts for _ in one.stop],
        **{
            name: np.concatenate([getattr(one, name) for _, _, one, _ in parts])
            for name in (
                "stop",
                "position_mm",
                "reading_mm",
                "beam_mm",
                "time_s",
                "temperature_c",
            )
        },
    )


def _waved(function: ErrorFunction, name: str, case: Case, seed: int) -> ErrorFunction:
    """Return a function with full waves over its axis, of a phase of their own; angular functions
    stay as they are."""
    if not case.waves or name not in DISPLACEMENTS:
        return function
    axis = "XYZ".index(name[2])
    phase = float(
        np.random.default_rng((seed, DISPLACEMENTS.index(name))).uniform(0.0, 2.0 * np.pi)
    )
    turn = 2.0 * np.pi * case.waves / BOX.size_mm[axis]
    return lambda at: function(at) + WAVE_UM * (np.sin(turn * at + phase) - np.sin(phase))


def judge(case: Case, seed: int, exact: ExactModel | None) -> Verdict:
    """Drive and solve one survey and hold what the result says against the truth."""
    machine = machine_of(case, seed)
    readings = drive(case, machine, seed)
    result = solve(readings, chain=case.chain)
    points = np.asarray(BOX.origin_mm) + np.random.default_rng(5).uniform(
        size=(POINTS, 3)
    ) * np.asarray(BOX.size_mm)
    true, found = machine.error_at(points), error_field_um(result, points)
    said = predicted(result, points, -found).without_rigid_motion
    fields: dict[When, NDArray[np.float64]] = {"before": true, "after": true - found}
    before, after = (
        Told(left_um(points, field), **written(said[when].rms_um))
        for when, field in fields.items()
    )
    best = exact.solve(readings.reading_mm * 1e3) if exact else None
    bound = left_um(points, true - best.error_at(points)) if best else float("nan")
    return Verdict(
        within=within(result, machine, case.increments),
        before=before,
        after=after,
        bound_um=bound,
    )


def _exact(case: Case) -> ExactModel:
    # it takes what each move misses by for noise of the stop
    noise_um = {
        kind: float(np.hypot(um, case.repeatability_um)) for kind, um in NOISE_UM.items()
    }
    return ExactModel(
        box=case.box,
        setups=tuple(case.setups),
        noise_um=noise_um,
        angle_urad=case.angle_urad,
        chain=case.chain,
    )


def row(case: Case, seeds: Sequence[int]) -> tuple[str, list[Verdict]]:
    """Return the line of the table for a class of machine, and what it was made of."""
    exact = _exact(case) if case.bounded else None
    verdicts = [judge(case, seed, exact) for seed in seeds]
    judged = [
        [one for verdict in verdicts for one in verdict.within[kind]]
        for kind in ("functions", "squareness", "scale")
    ]
    shares = [100 * np.mean(kind) if kind else np.nan for kind in judged]
    before, after = (
        100 * np.mean([getattr(verdict, when).inside for verdict in verdicts])
        for when in ("before", "after")
    )
    below = sum(verdict.after.true < verdict.after.low for verdict in verdicts)
    left, bound = (
        np.sqrt(np.mean(np.square(values)))
        for values in zip(*((one.after.true, one.bound_um) for one in verdicts), strict=True)
    )
    cells = ["-" if np.isnan(share) else f"{share:.0f}" for share in (*shares, before, after)]
    first = f"{np.mean([one.before.true for one in verdicts]):.1f}"
    best = "-" if np.isnan(bound) else f"{bound:.2f}"
    return (
        (
            f"| {case.name} | {' | '.join(cells)} | {below} | {wider(verdicts):.1f} | {first} | "
            f"{left:.2f} | {best} |"
        ),
        verdicts,
    )


def wider(verdicts: Sequence[Verdict], when: str = "after") -> float:
    """Return how many times wider the intervals (after compensation, or before) are than 95 % of
    these machines needed."""
    return 1.0 / max(
        float(np.quantile([getattr(one, when).used for one in verdicts], 0.95)), 1e-9
    )


def print_mixed(seeds: Sequence[int]) -> None:
    """Print what machines drawn over all classes together show: inside, wider than needed, within 2
    u."""
    verdicts = [judge(drawn_case(seed), seed, None) for seed in seeds]
    for when in ("before", "after"):
        inside = sum(getattr(verdict, when).inside for verdict in verdicts)
        print(
            f"{when}: {inside} of {len(verdicts)} within, {wider(verdicts, when):.2f} times "
            "wider than needed"
        )
    for kind in ("functions", "squareness", "scale"):
        judged = [one for verdict in verdicts for one in verdict.within[kind]]
        print(f"{kind} within 2u: {100 * np.mean(judged):.0f} % of {len(judged)}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=12, help="surveys of each class")
    parser.add_argument(
        "--first",
        type=int,
        help=f"the first seed (default {FIRST_SEED}, false alarms {false_alarms.FIRST_SEED})",
    )
    parser.add_argument("--case", default="", help="only classes whose name contains this")
    parser.add_argument(
        "--mixed",
        type=int,
        default=0,
        metavar="N",
        help="N machines over all classes together, and no table",
    )
    parser.add_argument(
        "--false-alarms",
        type=int,
        metavar="N",
        help="N good surveys of each distribution, and no other table",
    )
    parser.add_argument(
        "--explained",
        type=int,
        metavar="N",
        help="N surveys of each truth beside the model, and no other table",
    )
    parser.add_argument(
        "--large",
        action="store_true",
        help="false alarms: ordinary machines with axes of 1 to 4 m",
    )
    options = parser.parse_args()
    first = FIRST_SEED if options.first is None else options.first
    if options.explained:
        explained.print_rows(range(first, first + options.explained), options.case)
        return
    if options.mixed:
        print_mixed(range(first, first + options.mixed))
    elif options.false_alarms is None:
        print_classes(range(first, first + options.surveys), options.case)
    if options.false_alarms or not (options.mixed or options.case):
        alarms = false_alarms.FIRST_SEED if options.first is None else options.first
        false_alarms.print_false_alarms(
            options.false_alarms or false_alarms.SURVEYS, alarms, large=options.large
        )
    if options.false_alarms is None and not (options.mixed or options.case):
        from benchmarks import fates, heads, proofs

        fates.print_table(fates.rows(fates.MACHINES))
        heads.print_table(heads.SEEDS)
        proofs.print_rates(proofs.MACHINES)


def print_classes(seeds: Sequence[int], part: str) -> None:
    """Print the table of the classes of machine whose name contains ``part``, and what all of them
    together show."""
    print(
        "| machine | functions within 2u, % | squareness | scale | before as predicted, % | "
        "after | of these better than promised |",
        end="",
    )
    print(" wider than needed | rms, um | left | exact least squares |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    mixed: list[Verdict] = []
    for case in CASES:
        if part in case.name:
            line, verdicts = row(case, seeds)
            print(line, flush=True)
            mixed += verdicts if case.angle_urad <= MIXED_URAD else []
    if not mixed:
        return
    inside, count = 100 * np.mean([verdict.after.inside for verdict in mixed]), len(mixed)
    print(
        f"\nAll classes up to {MIXED_URAD:g} urad: {inside:.0f} % within, {wider(mixed):.1f} "
        f"times wider than needed ({count} surveys)."
    )


if __name__ == "__main__":
    main()
