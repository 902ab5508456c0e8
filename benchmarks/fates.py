"""``python -m benchmarks.fates``: what becomes of machines over years, and what `trend` and
`compare` report of it.

Every survey is one of a machine that the virtual machine drove and the solver solved, noise and
all; what its fate changes is added to its result, which is linear in it. A machine has its own pool
of surveys, and every history draws from it. Counted a fate and calendar: machines with an invented
change; changes beyond 3 U that are reported as unchanged; steps whose interval holds the true
survey; days of leaving whose interval holds the true day; and the same two questions put to
`compare` for the first and the last survey.
"""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from benchmarks.honesty import Case, drive, machine_of
from stepdiag.base.result.members import ActiveFile, Facts
from stepdiag.base.result.result import Function, Result
from stepdiag.base.volume import Vector
from stepdiag.comparing.compare import compare
from stepdiag.fleet.history import history_of
from stepdiag.fleet.rows import about, rows_of
from stepdiag.fleet.tables import index_of, table_of
from stepdiag.fleet.trend import YEAR, Trend, trends_of
from stepdiag.solver.methods.solve import solve

CASE = Case(name="a machine of the works", angle_urad=15.0, increments=5)
POOL, FIRST_SEED = 24, 5000
MACHINES = 20
"""Of each fate and calendar."""
BEGIN, NOW = datetime(2015, 3, 1, 10, 0, tzinfo=UTC), datetime(2026, 11, 1, tzinfo=UTC)
CALENDARS: dict[str, tuple[int, ...]] = {
    "a quarter": tuple(91 * number for number in range(20)),
    "a year": tuple(365 * number for number in range(8)),
    "two visits": (0, 2, 5, 730, 732, 735),
}
SIZES_U = (3.2, 10.0)
"""Sizes of what changes, in U (k = 2) of a survey."""
WATCHED = "C0Y"


@dataclass(kw_only=True)
class Life:
    """A history as it is drawn: results with their days, and the truth: which quantities change, at
    which survey, when one leaves."""

    results: list[Result]
    days: list[float]
    truth: float
    """The squareness `WATCHED` of the machine as it began."""
    touched: set[str] = field(default_factory=set)
    at: int | None = None
    course: str = ""
    leaves: tuple[float, float] | None = None
    """Tolerance of `WATCHED`, and the day."""

    def facts(self, number: int, **stated: object) -> None:
        """State something of one survey."""
        result = self.results[number]
        facts = replace(result.survey or Facts(), **stated)  # type: ignore[arg-type]
        self.results[number] = replace(result, survey=facts)


Fate = Callable[[Life, np.random.Generator], None]


def pool_of(number: int) -> list[Result]:
    """Return surveys of one machine, each with noise, drift and mirror of its own."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    machine = machine_of(CASE, FIRST_SEED + number)
    return [
        solve(drive(CASE, machine, 100 * (FIRST_SEED + number) + survey))
        for survey in range(POOL)
    ]


def _size(life: Life, dice: np.random.Generator, name: str) -> float:
    """Draw the size of a change of a quantity."""
    first = life.results[0]
    u = (
        first.squareness[name].u
        if name in first.squareness
        else float(np.max(first.errors[name].u))  # type: ignore[arg-type]
    )
    assert u is not None
    return float(dice.choice([-1, 1]) * dice.uniform(*SIZES_U)) * 2 * u


def _squarer(result: Result, name: str, by: float) -> Result:
    value = result.squareness[name].value
    assert value is not None
    return replace(
        result,
        squareness={
            **result.squareness,
            name: replace(result.squareness[name], value=value + by),
        },
    )


def _bent(result: Result, name: str, by: Callable[[Function], Vector]) -> Result:
    function = result.errors[name]
    assert function.value is not None
    return replace(
        result,
        errors={
            **result.errors,
            name: replace(function, value=function.value + by(function)),
        },
    )


def _change_at(life: Life, dice: np.random.Generator) -> int:
    life.at = 3 if len(life.results) == 6 else int(dice.integers(1, len(life.results)))
    life.course = "step"
    return life.at


def constant(life: Life, _dice: np.random.Generator) -> None:
    """Leave the machine as it is."""
    life.course = "constant"


def crash(life: Life, dice: np.random.Generator) -> None:
    """Move one squareness at a survey that names the event."""
    size, at = _size(life, dice, WATCHED), _change_at(life, dice)
    life.touched = {WATCHED}
    for number in range(at, len(life.results)):
        life.results[number] = _squarer(life.results[number], WATCHED, size)
    life.facts(at, event="crash")


def unnoticed(life: Life, dice: np.random.Generator) -> None:
    """Move one squareness, and nobody names it."""
    crash(life, dice)
    assert life.at is not None
    life.facts(life.at, event="")


def dent(life: Life, dice: np.random.Generator) -> None:
    """Bend one straightness at a place."""
    size, at = _size(life, dice, "EYX"), _change_at(life, dice)
    life.touched = {"EYX"}
    for number in range(at, len(life.results)):
        life.results[number] = _bent(
            life.results[number],
            "EYX",
            lambda each: size * np.eye(len(each.position_mm))[len(each.position_mm) // 2],
        )


def turned(life: Life, dice: np.random.Generator) -> None:
    """Turn the sign of two functions: their ranges stay."""
    at = _change_at(life, dice)
    life.touched = {"EXX", "EYX"}
    for name in life.touched:
        u = life.results[0].errors[name].u
        assert u is not None
        high = 2 * SIZES_U[0] * 2 * float(np.max(u))
        for number in range(len(life.results)):
            sign = -1.0 if number >= at else 1.0

            def bow(each: Function, sign: float = sign, high: float = high) -> Vector:
                along = (each.position_mm - each.position_mm[0]) / np.ptp(each.position_mm)
                shape: Vector = sign * high * np.sin(np.pi * along)
                return shape

            life.results[number] = _bent(life.results[number], name, bow)


def drift(life: Life, dice: np.random.Generator) -> None:
    """Let one squareness run away over the years, and state the day on which it leaves a
    tolerance."""
    size = _size(life, dice, WATCHED)
    years = np.array(life.days) / YEAR.days
    slope = size / years[-1]
    life.touched, life.course = {WATCHED}, "line"
    for number, at in enumerate(years):
        life.results[number] = _squarer(life.results[number], WATCHED, slope * at)
    ahead = float(dice.uniform(0.3, 1.5)) * years[-1]
    tolerance = abs(life.truth + slope * (years[-1] + ahead))
    if (
        np.sign(life.truth + slope * (years[-1] + ahead)) == np.sign(slope)
        and abs(life.truth + slope * years[-1]) < tolerance
    ):
        life.leaves = (tolerance, (years[-1] + ahead) * YEAR.days)


def season(life: Life, dice: np.random.Generator) -> None:
    """Let one squareness go up and down with the year."""
    size = abs(_size(life, dice, WATCHED))
    shift = np.array([size * np.sin(2 * np.pi * day / YEAR.days) for day in life.days])
    for number, by in enumerate(shift):
        life.results[number] = _squarer(life.results[number], WATCHED, float(by))
    if np.ptp(shift) > size:
        life.touched, life.course = {WATCHED}, "season"
    else:
        life.course = "unseen"


def run_in(life: Life, dice: np.random.Generator) -> None:
    """Let one squareness settle."""
    size = _size(life, dice, WATCHED)
    life.touched, life.course = {WATCHED}, "run-in"
    for number, day in enumerate(life.days):
        life.results[number] = _squarer(
            life.results[number], WATCHED, size * (1 - np.exp(-day / (0.2 * life.days[-1])))
        )


def loaded(life: Life, dice: np.random.Generator) -> None:
    """Load other tables before about every fourth survey."""
    life.touched = set(life.results[0].squareness)
    files: tuple[ActiveFile, ...] = ()
    by = dict.fromkeys(life.results[0].squareness, 0.0)
    for number in range(len(life.results)):
        if number % 4 == 3:
            files = (ActiveFile(name="t", sha256=f"{number:064x}", date="", source=""),)
            by = {name: _size(life, dice, name) for name in by}
        for name, size in by.items():
            life.results[number] = _squarer(life.results[number], name, size)
        life.facts(number, active_files=files, compensation="on" if files else "off")


def levelled(life: Life, dice: np.random.Generator) -> None:
    """Level the machine anew: all squarenesses move, and the survey names it."""
    at = _change_at(life, dice)
    life.touched = set(life.results[0].squareness)
    sizes = {name: _size(life, dice, name) for name in sorted(life.touched)}
    for number in range(at, len(life.results)):
        for name, size in sizes.items():
            life.results[number] = _squarer(life.results[number], name, size)
    life.facts(at, event="re-levelled")


def smaller(life: Life, dice: np.random.Generator) -> None:
    """Measure a part of the travel from some survey on."""
    at = int(dice.integers(1, len(life.results)))
    for number in range(at, len(life.results)):
        result = life.results[number]
        errors = {
            name: replace(
                each,
                position_mm=each.position_mm[:-1],
                value=each.value[:-1],
                u=each.u[:-1],  # type: ignore[index]
            )
            for name, each in result.errors.items()
            if each.value is not None
        }
        x, y, z = (0.8 * each for each in result.volume.size_mm)
        life.results[number] = replace(
            result,
            errors=errors,
            reversal={},
            volume=replace(result.volume, size_mm=(x, y, z)),
        )


def coarser(life: Life, dice: np.random.Generator) -> None:
    """Measure fewer targets from some survey on."""
    at = int(dice.integers(1, len(life.results)))
    for number in range(at, len(life.results)):
        result = life.results[number]
        errors = {
            name: replace(
                each,
                position_mm=each.position_mm[[0, 2, 5]],
                value=each.value[[0, 2, 5]],
                u=each.u[[0, 2, 5]],  # type: ignore[index]
            )
            for name, each in result.errors.items()
            if each.value is not None and len(each.position_mm) == 6
        }
        life.results[number] = replace(
            result, errors={**result.errors, **errors}, reversal={}
        )


def other_laser(life: Life, dice: np.random.Generator) -> None:
    """Measure by another laser from some survey on, whose wavelength and air sensor differ by what
    their u allows."""
    at = int(dice.integers(1, len(life.results)))
    ppm = 0.2 * np.sqrt(2) * float(dice.normal())
    for number in range(len(life.results)):
        life.facts(number, instrument="LDDM", instrument_serial="2" if number >= at else "1")
        if number >= at:
            for name in ("EXX", "EYY", "EZZ"):
                life.results[number] = _bent(
                    life.results[number],
                    name,
                    lambda each: ppm * 1e-3 * (each.position_mm - each.position_mm[0]),
                )


def other_software(life: Life, dice: np.random.Generator) -> None:
    """Solve by another version from some survey on."""
    for number in range(int(dice.integers(1, len(life.results))), len(life.results)):
        result = life.results[number]
        life.results[number] = replace(
            result, software=replace(result.software, version="0.1")
        )


def scattering(life: Life, dice: np.random.Generator) -> None:
    """Let every survey scatter by twice what its U explains."""
    for number in range(len(life.results)):
        result = life.results[number]
        for name, each in result.squareness.items():
            if each.u is not None:
                result = _squarer(result, name, 2 * each.u * float(dice.normal()))
        for name, function in result.errors.items():
            if function.u is not None:
                along = np.linspace(0.0, 1.0, len(function.u))
                noise = (
                    2
                    * function.u
                    * (dice.normal() * np.sqrt(along) + dice.normal() * np.sqrt(1 - along))
                )
                result = _bent(result, name, lambda _, noise=noise: noise)  # type: ignore[misc]
        life.results[number] = result


def gaps(life: Life, dice: np.random.Generator) -> None:
    """Leave out years."""
    kept = sorted(
        dice.choice(len(life.results), max(len(life.results) // 2, 3), replace=False).tolist()
    )
    life.results, life.days = (
        [life.results[number] for number in kept],
        [life.days[number] for number in kept],
    )


def wrong_clock(life: Life, dice: np.random.Generator) -> None:
    """Date one survey by a clock that was never set, or far ahead."""
    life.days[int(dice.integers(len(life.days)))] = float(
        dice.choice([-45 * YEAR.days, 80 * YEAR.days])
    )


FATES: dict[str, Fate] = {
    "constant": constant,
    "crash": crash,
    "crash nobody names": unnoticed,
    "dent in a straightness": dent,
    "drift": drift,
    "season": season,
    "run-in": run_in,
    "loaded every year": loaded,
    "re-levelled": levelled,
    "sign turned": turned,
    "other volume": smaller,
    "other increments": coarser,
    "other laser": other_laser,
    "other software": other_software,
    "scatters by 2 u more": scattering,
    "missing years": gaps,
    "wrong clock": wrong_clock,
}


def _volumetric() -> set[str]:
    return {"volumetric-rms", "volumetric-largest"}


@dataclass(kw_only=True)
class Count:
    """What was counted of a fate on one calendar."""

    machines: int = 0
    invented: int = 0
    changes: int = 0
    found: int = 0
    denied: int = 0
    steps: int = 0
    since: int = 0
    days: int = 0
    days_held: int = 0
    pairs: int = 0
    pairs_invented: int = 0
    pairs_changed: int = 0
    pairs_denied: int = 0


def lived(
    pool: Sequence[Result], truth: float, fate: Fate, days: Sequence[int], seed: Sequence[int]
) -> Life:
    """Draw a history of a machine."""
    dice = np.random.default_rng(seed)
    chosen = dice.choice(len(pool), len(days), replace=False)
    results = [
        replace(pool[int(number)], survey=Facts(machine="m", survey="s", compensation="off"))
        for number in chosen
    ]
    life = Life(results=results, days=[float(day) for day in days], truth=truth)
    fate(life, dice)
    for number, day in enumerate(life.days):
        life.facts(number, ended=(BEGIN + timedelta(days=day)).strftime("%Y-%m-%d %H:%M UTC"))
    return life


def trends(life: Life) -> list[Trend]:
    """Return what `trend` makes of a history."""
    tables = [
        (table_of(about(result, f"{number:016x}"), list(rows_of(result))), f"p{number}")
        for number, result in enumerate(life.results)
    ]
    found = history_of(index_of(tables), NOW).series
    return trends_of(
        found,
        lambda _, quantity: (
            life.leaves[0] if life.leaves is not None and quantity == WATCHED else None
        ),
    )


def judge(life: Life, count: Count) -> None:
    """Hold what is reported of a history against its truth."""
    count.machines += 1
    touched = life.touched | (_volumetric() if life.touched else set())
    found = trends(life)
    count.invented += any(
        each.verdict == "changed" for each in found if each.series.quantity not in touched
    )
    for each in found:
        if each.series.quantity in life.touched - _volumetric() and each.series.other is None:
            count.changes += 1
            count.found += each.verdict == "changed"
            count.denied += each.verdict == "unchanged"
            if life.course == "step":
                count.steps += 1
                count.since += any(step.first < life.at <= step.last for step in each.steps)  # type: ignore[operator]
        if (
            each.series.quantity == WATCHED
            and life.leaves is not None
            and each.leaving is not None
            and each.outside == "no"
        ):
            count.days += 1
            day = BEGIN + timedelta(days=life.leaves[1])
            early, late = each.leaving.earliest, each.leaving.latest
            count.days_held += (
                early is not None and early <= day and (late is None or day <= late)
            )
    _judge_pair(life, count)


def _judge_pair(life: Life, count: Count) -> None:
    """Put the question to `compare`: first and last survey."""
    changes = {each.name: each for each in compare(life.results[0], life.results[-1]).changes}
    count.pairs += 1
    count.pairs_invented += any(
        each.significant for name, each in changes.items() if name not in life.touched
    )
    if life.course in ("step", "line"):
        count.pairs_changed += len(life.touched)
        count.pairs_denied += sum(
            changes[name].verdict == "unchanged" for name in life.touched
        )


def rows(machines: int, first: int = 0, only: str = "") -> dict[tuple[str, str], Count]:
    """Return the counts by fate and calendar."""
    numbers = range(first, first + machines)
    with ProcessPoolExecutor(2) as workers:
        pools = dict(zip(numbers, workers.map(pool_of, numbers), strict=True))
    truths = {
        number: float(machine_of(CASE, FIRST_SEED + number).errors.squareness_urad[WATCHED])
        for number in numbers
    }
    found: dict[tuple[str, str], Count] = {}
    for place, (name, fate) in enumerate(FATES.items()):
        for calendar, days in CALENDARS.items():
            if only in name:
                count = found.setdefault((name, calendar), Count())
                for number in numbers:
                    judge(
                        lived(
                            pools[number],
                            truths[number],
                            fate,
                            days,
                            (place, len(days), number),
                        ),
                        count,
                    )
    return found


def print_table(found: Mapping[tuple[str, str], Count]) -> None:
    """Print the table."""
    print(
        "| fate | surveys | invented | changes found | denied | since when | day of leaving | "
        "compare: invented | compare: denied |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for (fate, calendar), each in found.items():
        parts = (
            f"{each.invented} of {each.machines}",
            f"{each.found} of {each.changes}" if each.changes else "-",
            str(each.denied) if each.changes else "-",
            f"{each.since} of {each.steps}" if each.steps else "-",
            f"{each.days_held} of {each.days}" if each.days else "-",
            f"{each.pairs_invented} of {each.pairs}",
            f"{each.pairs_denied} of {each.pairs_changed}" if each.pairs_changed else "-",
        )
        print(f"| {fate} | {calendar} | {' | '.join(parts)} |")
    total = list(found.values())
    invented, machines = (
        sum(each.invented for each in total),
        sum(each.machines for each in total),
    )
    held, days = sum(each.days_held for each in total), sum(each.days for each in total)
    since, steps = sum(each.since for each in total), sum(each.steps for each in total)
    denied = sum(each.denied for each in total)
    print(
        f"\nall: invented {invented} of {machines}, denied {denied}, since when {since} of "
        f"{steps}, day held {held} of {days}"
    )


def main() -> None:
    """Draw the lives and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--machines", type=int, default=MACHINES, help="of each fate and calendar"
    )
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        help="number of the first machine: others are other machines",
    )
    parser.add_argument("--fate", default="", help="only fates whose name contains this")
    options = parser.parse_args()
    print_table(rows(options.machines, options.first, options.fate))


if __name__ == "__main__":
    main()
