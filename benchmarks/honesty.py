"""``python -m benchmarks.honesty``: does what the solver says of itself hold, against exact machines that share no code with it?

For every class of machine: the share of true values within 2 u by class of quantity, the share of true volumetric errors (before, after an
ideal compensation) within the predicted interval, how wide that is, and the rms that is left.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.solver.geometry.volume import Vector
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.readings.readings import Readings, make_readings
from stepdiag.solver.result.field import error_field_um, without_rigid_motion
from stepdiag.solver.result.result import DISPLACEMENTS, SQUARENESS, Result
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment, Conditions, simulate_pass
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import Amplitudes, ErrorSet, random_errors
from stepdiag.virtual.physics.machine import Machine

SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
BOX = Box(origin_mm=(0.0, 0.0, 0.0), size_mm=(500.0, 400.0, 300.0), increments=10)
NOISE_UM = {"linear": 0.2, "diagonal": 0.3}
TILT_MRAD = 0.5


@dataclass(frozen=True, kw_only=True)
class Case:
    """A class of machine: range of its angular functions (the solver assumes 10 urad), chain, drift, backlash, warming."""

    name: str
    angle_urad: float = 0.0
    chain: str = "FXYZ"
    drift_um_h: float = 0.0
    backlash_um: float = 0.0
    warming_c_h: float = 0.0
    passes: Sequence[int] = (1,)


CASES = (
    *(Case(name=f"{size:g} urad, {chain}", angle_urad=size, chain=chain) for chain in ("FXYZ", "XYFZ") for size in (0, 2, 5, 10, 20, 50)),
    Case(name="10 urad, drift 2 um/h", angle_urad=10, drift_um_h=2.0),
    Case(name="5 urad, backlash 4 um, out and back", angle_urad=5, backlash_um=4.0, passes=(1, 2)),
    Case(name="5 urad, 0.1 C/h", angle_urad=5, warming_c_h=0.1),
)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What one survey showed."""

    within: dict[str, list[bool]]
    predicted: list[bool]
    width: float
    left_um: float


def machine_of(case: Case, seed: int) -> Machine:
    """Return a drawn machine: 9 um of positioning and straightness, scales to 20 um/m, squareness 20 urad."""
    wanted = Amplitudes(positioning_um=9.0, straightness_um=9.0, angle_urad=case.angle_urad, scale_um_m=20.0)
    drawn = random_errors(seed, BOX.origin_mm, BOX.size_mm, wanted)
    lost = {f"E{axis}{axis}": (lambda at, um=case.backlash_um: np.full_like(at, -um)) for axis in "XYZ"} if case.backlash_um else {}
    errors = ErrorSet(
        low_mm=drawn.low_mm, size_mm=drawn.size_mm, functions=drawn.functions, squareness_urad=drawn.squareness_urad, reversal=lost
    )
    drift = tuple(float(one) for one in case.drift_um_h * np.random.default_rng(seed).choice([-1.0, 1.0], 3))
    hall = Environment(material_c=Course(start=20.0, per_hour=case.warming_c_h))
    return Machine(errors=errors, chain=case.chain, drift_um_h=drift, expansion_um_m_c=(11.7,) * 3, environment=hall)  # type: ignore[arg-type]


def drive(case: Case, machine: Machine, seed: int) -> Readings:
    """Return the readings of four diagonals and three linear runs, mirror and beam leaning half a milliradian."""
    rng = np.random.default_rng(1000 + seed)
    parts, start_s = [], 0.0
    for setup in SETUPS:
        linear = setup.startswith("linear")
        mirror, beam = (tuple(TILT_MRAD * np.array([np.cos(turn), np.sin(turn)])) for turn in rng.uniform(0, 2 * np.pi, 2))
        how = Alignment(mirror_mrad=mirror, beam_mrad=(0.0, 0.0) if linear else beam)  # type: ignore[arg-type]
        noise = NOISE_UM["linear" if linear else "diagonal"]
        for number in case.passes:
            taken = Conditions(noise_um=noise, seed=int(rng.integers(1 << 31)), start_s=start_s)
            one = simulate_pass(machine, BOX, setup, number, alignment=how, conditions=taken)
            parts.append((setup, number, one, noise))
            start_s = float(one.time_s[-1]) + 600.0
    return make_readings(
        setup=[setup for setup, _, one, _ in parts for _ in one.stop],
        pass_number=[number for _, number, one, _ in parts for _ in one.stop],
        u_um=[noise for *_, one, noise in parts for _ in one.stop],
        **{
            name: np.concatenate([getattr(one, name) for _, _, one, _ in parts])
            for name in ("stop", "position_mm", "reading_mm", "beam_mm", "time_s", "temperature_c")
        },
    )


def judge(case: Case, seed: int) -> Verdict:
    """Drive and solve one survey and hold what the result says against the truth."""
    machine = machine_of(case, seed)
    result = solve(drive(case, machine, seed), chain=case.chain)
    points = _lattice_mm()
    true = machine.error_at(points)
    before, after = (_rms_um(result, points, field) for field in (true, true - error_field_um(result, points)))
    said = result.extra["predicted"]["without_rigid_motion"]
    intervals = [said[when]["rms_um"] for when in ("before", "after")]
    inside = [one["low"] <= found <= one["high"] for one, found in zip(intervals, (before, after), strict=True)]
    width = (intervals[1]["high"] - intervals[1]["low"]) / max(after, 1e-9)
    return Verdict(within=_within(result, machine), predicted=inside, width=width, left_um=after)


def _lattice_mm() -> Vector:
    axes = [low + size * np.linspace(0.0, 1.0, 6) for low, size in zip(BOX.origin_mm, BOX.size_mm, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _rms_um(result: Result, points: Vector, field: Vector) -> float:
    return float(np.sqrt(np.mean(np.sum(without_rigid_motion(result.volume, points, field) ** 2, axis=1))))


def _within(result: Result, machine: Machine) -> dict[str, list[bool]]:
    """Return whether each true value lies within 2 u, by class of quantity."""
    truth = machine.truth(BOX.increments)
    found: dict[str, list[bool]] = {"functions": [], "squareness": [], "scale": []}
    for name in DISPLACEMENTS:
        function = result.errors[name]
        if function.value is not None and function.u is not None:
            told = function.u > 1e-9
            found["functions"] += (np.abs(function.value - truth.errors[name])[told] <= 2 * function.u[told]).tolist()
    for name in SQUARENESS:
        number = result.squareness[name]
        found["squareness"].append(abs((number.value or 0.0) - truth.squareness_urad[name]) <= 2 * (number.u or 0.0))
    for axis, scale in result.scale.items():
        found["scale"].append(abs((scale.value or 0.0) - truth.scale_um_m[axis]) <= 2 * (scale.u or 0.0))
    return found


def row(case: Case, surveys: int) -> str:
    """Return the line of the table for a class of machine."""
    verdicts = [judge(case, seed) for seed in range(surveys)]
    shares = [100 * np.mean([one for verdict in verdicts for one in verdict.within[kind]]) for kind in ("functions", "squareness", "scale")]
    before, after = (100 * np.mean([verdict.predicted[place] for verdict in verdicts]) for place in (0, 1))
    left = np.sqrt(np.mean([verdict.left_um**2 for verdict in verdicts]))
    width = np.median([verdict.width for verdict in verdicts])
    cells = [f"{share:.0f}" for share in (*shares, before, after)]
    return f"| {case.name} | {' | '.join(cells)} | {width:.1f} | {left:.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=20, help="surveys of each class")
    parser.add_argument("--case", default="", help="only classes whose name contains this")
    options = parser.parse_args()
    print("| machine | functions within 2u, % | squareness | scale | before as predicted, % | after | interval / rms | rms left, um |")
    print("|---|---|---|---|---|---|---|---|")
    for case in CASES:
        if options.case in case.name:
            print(row(case, options.surveys), flush=True)


if __name__ == "__main__":
    main()
