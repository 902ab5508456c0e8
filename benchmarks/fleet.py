"""``python -m benchmarks.fleet STORE``: a works of machines over years, each survey driven by the
virtual machine and solved.

Half of the machines stay as they are, a quarter drifts, a quarter crashes once; all of them feel
the seasons, and their surveys are brought to 20 C with a sensor that errs and a coefficient that is
not quite theirs. The truth is known, so it can be counted how often a change is said where there is
none, and how often one that is there is found, on its day.
"""

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial

import numpy as np

from benchmarks.honesty import Case, drive
from stepdiag.base.conditions.expansion import expansion_um
from stepdiag.base.readings.readings import Readings
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.archive import put_table, refresh_index
from stepdiag.fleet.history import history_in
from stepdiag.fleet.rows import About, rows_of
from stepdiag.fleet.store import Place, Store
from stepdiag.fleet.tables import table_of, to_parquet
from stepdiag.fleet.trend import YEAR, Trend, trends_of
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.sequence import outward_direction
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine

CASE = Case(name="a machine of the works", angle_urad=4.0, increments=2)
BOX = CASE.box
SIZES = Amplitudes(
    positioning_um=6.0,
    straightness_um=5.0,
    angle_urad=4.0,
    scale_um_m=10.0,
    squareness_urad=15.0,
)
FIRST = datetime(2016, 1, 15, 10, 0, tzinfo=UTC)
QUARTER = timedelta(days=91.3125)
SEASON_C, SENSOR_C = 4.0, 0.15
ASSUMED_UM_M_C, TRUE_SPREAD_UM_M_C = 11.7, 0.5
WATCHED, TOLERANCE_URAD = "C0Y", 50.0
"""The quantity that drifts and steps here, and the tolerance it is held against."""


@dataclass(frozen=True, kw_only=True)
class Life:
    """What becomes of a machine: ``drift`` of C0Y in urad a year, ``crash`` the survey before which
    it steps by ``step`` urad."""

    number: int
    drift: float = 0.0
    crash: int | None = None
    step: float = 0.0

    @property
    def name(self) -> str:
        """Return its name, which says nothing of its fate."""
        return f"mill-{self.number:03d}"

    def squareness_urad(self, years: float, survey: int) -> float:
        """Return what C0Y has changed by."""
        return self.drift * years + (
            self.step if self.crash is not None and survey >= self.crash else 0.0
        )


def life_of(number: int, surveys: int) -> Life:
    """Draw the fate of a machine."""
    dice = np.random.default_rng((17, number))
    sign = float(dice.choice([-1.0, 1.0]))
    if number % 4 == 1:
        return Life(number=number, drift=sign * float(dice.uniform(2.0, 8.0)))
    if number % 4 == 3:
        return Life(
            number=number,
            crash=int(
                dice.integers(surveys // 4 + 1, max(3 * surveys // 4, surveys // 4 + 2))
            ),
            step=sign * float(dice.uniform(25.0, 70.0)),
        )
    return Life(number=number)


def surveyed(life: Life, survey: int) -> tuple[About, Readings]:
    """Return one survey of a machine, its readings brought to 20 C as the daemon does."""
    dice = np.random.default_rng((life.number, survey))
    when = FIRST + survey * QUARTER + timedelta(days=float(dice.uniform(-10, 10)))
    years = (when - FIRST) / YEAR
    drawn = random_errors(1000 + life.number, BOX.origin_mm, BOX.size_mm, SIZES)
    square = {
        **drawn.squareness_urad,
        WATCHED: drawn.squareness_urad[WATCHED] + life.squareness_urad(years, survey),
    }
    grows = ASSUMED_UM_M_C + TRUE_SPREAD_UM_M_C * float(
        np.random.default_rng((3, life.number)).normal()
    )
    warm = 20.0 + SEASON_C * float(np.sin(2 * np.pi * years)) + float(dice.normal(0.0, 0.5))
    machine = Machine(
        errors=replace(drawn, squareness_urad=square),
        expansion_um_m_c=(grows,) * 3,
        environment=Environment(material_c=Course(start=warm)),
    )
    readings = _at_20_c(
        drive(CASE, machine, int(dice.integers(1 << 30))), SENSOR_C * float(dice.normal())
    )
    event = "crash" if survey == life.crash else ""
    return About(
        machine=life.name,
        survey=f"{life.number:08x}{survey:08x}",
        time=when,
        event=event,
        method="estimate",
        software="generated",
        conditions="{}",
    ), readings


def _at_20_c(readings: Readings, sensor_c: float) -> Readings:
    """Return the readings less what the axes are longer by, as the sensor says, which errs by so
    much."""
    warm = readings.temperature_c + sensor_c
    grown = np.zeros(len(warm))
    for setup in dict.fromkeys(readings.setup):
        rows = np.array([name == setup for name in readings.setup])
        at = readings.position_mm[rows]
        grown[rows] = expansion_um(
            at - at[0],
            outward_direction(BOX, setup),
            (ASSUMED_UM_M_C,) * 3,
            warm[rows][:, None] * np.ones(3),
        )
    return replace(
        readings,
        reading_mm=readings.reading_mm - grown * 1e-3,
        temperature_c=warm,
        at_20_c=np.ones(len(warm), dtype=np.bool_),
    )


def make_machine(address: str, surveys: int, number: int) -> int:
    """Put all surveys of one machine into a store, as if they had been archived; return how many.
    What is there already stays."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    store, life = Store(address), life_of(number, surveys)
    made = 0
    for survey in range(surveys):
        about, readings = surveyed(life, survey)
        place = Place(about.machine, str(about.time.year), about.survey)
        if not store.exists(place.table):
            put_table(
                store,
                place,
                {RESULT: "0" * 64},
                to_parquet(table_of(about, list(rows_of(solve(readings))))),
            )
            made += 1
    return made


@dataclass(frozen=True, kw_only=True)
class Judged:
    """Counts over a fleet: series without a change, those of them that were said to have one; what
    was found of crashes and drifts."""

    still: int
    steps_invented: int
    lines_invented: int
    crashes: int
    crashes_found: int
    drifts: int
    slopes_right: int
    leavings: int
    leavings_right: int


def judged(trends: Sequence[Trend], lives: dict[str, Life]) -> Judged:
    """Hold what is said against what happened. Only C0Y, and the volumetric error with it, really
    change."""
    quiet = [
        each
        for each in trends
        if not (_moved(lives[each.series.machine]) and _touched(each.series.quantity))
    ]
    watched = {
        each.series.machine: each for each in trends if each.series.quantity == WATCHED
    }
    crashed = [
        (watched[life.name], life) for life in lives.values() if life.crash is not None
    ]
    drifted = [(watched[life.name], life) for life in lives.values() if life.drift]
    slopes = [
        each.line is not None and abs(each.line.size - life.drift) <= 2 * each.line.u
        for each, life in drifted
    ]
    leaving = [
        (each, life)
        for each, life in drifted
        if each.leaving is not None and each.outside == "no"
    ]
    return Judged(
        still=len(quiet),
        steps_invented=sum(bool(each.steps) for each in quiet),
        lines_invented=sum(each.line is not None for each in quiet),
        crashes=len(crashed),
        crashes_found=sum(_found(each, life) for each, life in crashed),
        drifts=len(drifted),
        slopes_right=sum(slopes),
        leavings=len(leaving),
        leavings_right=sum(_in_time(each, life) for each, life in leaving),
    )


def _moved(life: Life) -> bool:
    return bool(life.drift) or life.crash is not None


def _touched(quantity: str) -> bool:
    return quantity == WATCHED or quantity.startswith("volumetric")


def _found(trend: Trend, life: Life) -> bool:
    """Tell whether the crash is said, before the right survey, with its name."""
    (crash,) = (
        number
        for number, survey in enumerate(trend.series.surveys)
        if survey.event == "crash"
    )
    return any(
        step.at == crash
        and trend.cause(step) == "crash"
        and abs(step.size - life.step) <= 4 * step.u
        for step in trend.steps
    )


def _in_time(trend: Trend, life: Life) -> bool:
    """Tell whether the true day of leaving lies in the interval that is said."""
    begun = random_errors(
        1000 + life.number, BOX.origin_mm, BOX.size_mm, SIZES
    ).squareness_urad[WATCHED]
    day = FIRST + YEAR * ((np.copysign(TOLERANCE_URAD, life.drift) - begun) / life.drift)
    leaving = trend.leaving
    assert leaving is not None
    return (
        leaving.earliest is not None
        and leaving.earliest <= day
        and (leaving.latest is None or day <= leaving.latest)
    )


def lives_of(machines: int, surveys: int, first: int = 0) -> dict[str, Life]:
    """Return the fates of a fleet by name."""
    return {
        life.name: life
        for life in (life_of(number, surveys) for number in range(first, first + machines))
    }


def trends_in(store: Store) -> list[Trend]:
    """Return the trends of a store, C0Y against its tolerance."""
    return trends_of(
        history_in(store, datetime.now(UTC)).series,
        lambda _, quantity: TOLERANCE_URAD if quantity == WATCHED else None,
    )


def generate(
    address: str, machines: int, surveys: int, workers: int, first: int = 0
) -> Iterator[int]:
    """Make a fleet, machine by machine from number ``first`` on; yield how many surveys were solved
    for each."""
    Store(address, create=True)
    numbers = range(first, first + machines)
    if workers == 1:
        yield from (make_machine(address, surveys, number) for number in numbers)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from pool.map(partial(make_machine, address, surveys), numbers)


def main() -> None:
    """Make the fleet, and print what is said of it beside what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store")
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument(
        "--surveys", type=int, default=40, help="of each machine, four a year"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        help="number of the first machine: others are other machines",
    )
    options = parser.parse_args()
    began = time.monotonic()
    solved = sum(
        generate(
            options.store, options.machines, options.surveys, options.workers, options.first
        )
    )
    store = Store(options.store)
    refresh_index(store, most_loose=0)
    print(f"{solved} surveys driven and solved in {time.monotonic() - began:.0f} s")
    print(
        judged(trends_in(store), lives_of(options.machines, options.surveys, options.first))
    )


if __name__ == "__main__":
    main()
