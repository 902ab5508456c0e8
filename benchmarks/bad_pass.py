"""``python -m benchmarks.bad_pass``: what becomes of a survey with one bad pass: repaired, named
and refused, or unseen and within U?

Four diagonals and three linear runs, driven once, of the exact machines of `benchmarks.honesty`;
each fault is put on a pass drawn by the survey's seed, and the same survey without it is solved
beside.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.exact import left_um
from benchmarks.honesty import BOX, POINTS, SETUPS, Case, drive, machine_of
from benchmarks.told import Told, within
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.field import error_field_um
from stepdiag.base.result.prediction import predicted
from stepdiag.base.result.result import Result
from stepdiag.base.result.typed import written
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.physics.machine import Machine

DIAGONALS = SETUPS[:4]
STEEL_UM_M_C = 11.7
OF_EVERY_SURVEY = frozenset({"angles-unmeasured", "increments-coarse"})

Spoiled = tuple[Readings, str]
"""The readings, and the words that name what is wrong with them."""


def stepped(readings: Readings, rng: np.random.Generator, um: float) -> Spoiled:
    """Return the readings with a step of the count before a stop of any pass."""
    key, rows = list(readings.passes().items())[int(rng.integers(len(readings.passes())))]
    stop = int(rng.integers(2, len(rows) - 1))
    return _moved(
        readings, rows[stop:], um * rng.choice([-1.0, 1.0])
    ), f"{key}, stop {stop + 1} "


def longer(readings: Readings, rng: np.random.Generator, ppm: float) -> Spoiled:
    """Return the readings with one diagonal too long or too short."""
    setup = DIAGONALS[int(rng.integers(4))]
    rows = np.flatnonzero(np.array(readings.setup) == setup)
    return _moved(
        readings, rows, 1e-3 * ppm * rng.choice([-1.0, 1.0]) * readings.reading_mm[rows]
    ), setup


def wandering(readings: Readings, rng: np.random.Generator, um: float) -> Spoiled:
    """Return the readings with a random walk in one diagonal that has come ``um`` far at its end
    (standard deviation)."""
    setup = DIAGONALS[int(rng.integers(4))]
    rows = np.flatnonzero(np.array(readings.setup) == setup)
    walk = np.append(0.0, np.cumsum(rng.standard_normal(len(rows) - 1)))
    return _moved(readings, rows, um / np.sqrt(len(rows) - 1) * walk), setup


def warmed(
    readings: Readings, rng: np.random.Generator, celsius: float, *, told: bool
) -> Spoiled:
    """Return the readings of a machine that is warmer by so much in every setup than in the one
    before, 20 C on the mean; ``told``: by its thermometer."""
    order = np.array([SETUPS.index(name) for name in readings.setup], dtype=np.float64)
    excess = celsius * (order - np.mean(order)) * rng.choice([-1.0, 1.0])
    warm = _moved(
        readings, np.arange(len(readings)), 1e-3 * STEEL_UM_M_C * excess * readings.reading_mm
    )
    return replace(
        warm, temperature_c=20.0 + excess if told else np.full(len(readings), np.nan)
    ), "the machine grew by"


def _moved(
    readings: Readings, rows: Sequence[int] | np.ndarray, um: float | np.ndarray
) -> Readings:
    reading = readings.reading_mm.copy()
    reading[rows] += 1e-3 * um
    return replace(readings, reading_mm=reading)


FAULTS: dict[str, Callable[[Readings, np.random.Generator], Spoiled]] = {
    "step of 20 um in a pass": partial(stepped, um=20.0),
    "step of 2 um in a pass": partial(stepped, um=2.0),
    "5 ppm on one diagonal": partial(longer, ppm=5.0),
    "10 ppm on one diagonal": partial(longer, ppm=10.0),
    "20 ppm on one diagonal": partial(longer, ppm=20.0),
    "one diagonal wanders by 3 um": partial(wandering, um=3.0),
    "one diagonal wanders by 10 um": partial(wandering, um=10.0),
    "0.3 K warmer each setup, untold": partial(warmed, celsius=0.3, told=False),
    "0.3 K warmer each setup, told": partial(warmed, celsius=0.3, told=True),
}


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What one survey showed: the severest word, whether it named the fault, what is left with its
    interval, squarenesses within 2 u."""

    severity: str
    named: bool
    codes: tuple[str, ...]
    after: Told
    squareness: tuple[bool, ...]
    clean_um: float


def judge(
    case: Case, seed: int, spoil: Callable[[Readings, np.random.Generator], Spoiled]
) -> Seen:
    """Drive, spoil and solve one survey."""
    machine = machine_of(case, seed)
    clean = drive(case, machine, seed)
    spoiled, words = spoil(clean, np.random.default_rng(seed))
    result = solve(spoiled, chain=case.chain)
    told = [
        one
        for one in result.findings
        if one.severity in ("error", "warning") and one.code not in OF_EVERY_SURVEY
    ]
    errors = any(one.severity == "error" for one in told)
    return Seen(
        severity="refused" if errors else "said" if told else "quiet",
        named=any(words in str(one.words) for one in told),
        codes=tuple(one.code for one in told),
        after=_after(result, machine),
        squareness=tuple(within(result, machine, case.increments)["squareness"]),
        clean_um=_after(solve(clean, chain=case.chain), machine).true,
    )


def _after(result: Result, machine: Machine) -> Told:
    points = np.asarray(BOX.origin_mm) + np.random.default_rng(5).uniform(
        size=(POINTS, 3)
    ) * np.asarray(BOX.size_mm)
    found = error_field_um(result, points)
    said = predicted(result, points, -found).without_rigid_motion["after"].rms_um
    return Told(left_um(points, machine.error_at(points) - found), **written(said))


def row(name: str, seen: Sequence[Seen]) -> str:
    """Return the line of the table for a fault."""
    counts = [
        sum(one.severity == word for one in seen) for word in ("refused", "said", "quiet")
    ]
    used = [one for one in seen if one.severity != "refused"]
    left = [
        f"{np.sqrt(np.mean(np.square(values))):.2f}"
        for values in ([one.after.true for one in used], [one.clean_um for one in used])
        if used
    ]
    inside = f"{sum(one.after.inside for one in used)} of {len(used)}"
    square = [one for each in used for one in each.squareness]
    share = f"{100 * np.mean(square):.0f}" if square else "-"
    named = sum(one.named for one in seen)
    return (
        f"| {name} | {named} | {' | '.join(map(str, counts))} | {' | '.join(left or ['-', '-'])} "
        f"| {inside} | {share} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surveys", type=int, default=20, help="surveys of each fault")
    parser.add_argument("--first", type=int, default=2000, help="the first seed")
    parser.add_argument(
        "--angle",
        type=float,
        default=0.0,
        help="range of the machine's angular functions, urad",
    )
    parser.add_argument("--fault", default="", help="only faults whose name contains this")
    parser.add_argument("--each", action="store_true", help="print every survey too")
    options = parser.parse_args()
    print(
        "| fault | named | refused | said | quiet | left, um | without the fault | in its "
        "interval | squareness within 2u, % |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    case = Case(name="", angle_urad=options.angle)
    for name, spoil in FAULTS.items():
        if options.fault in name:
            seen = [
                judge(case, seed, spoil)
                for seed in range(options.first, options.first + options.surveys)
            ]
            print(row(name, seen), flush=True)
            for one in seen if options.each else ():
                print(
                    "   ",
                    one.severity,
                    one.named,
                    one.codes,
                    f"{one.after.true:.2f} {one.clean_um:.2f}",
                )


if __name__ == "__main__":
    main()
