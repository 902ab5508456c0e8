"""Finished surveys and made-up histories for the tests of a fleet."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.errors import DataError
from stepdiag.base.files import write_hashed
from stepdiag.base.result.result import parse_result
from stepdiag.completion.completion import complete
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.archive import put_table
from stepdiag.fleet.history import history_in
from stepdiag.fleet.rows import RMS, About, Row
from stepdiag.fleet.series import Series, Survey
from stepdiag.fleet.store import Place, Store
from stepdiag.fleet.tables import table_of, to_parquet
from stepdiag.fleet.trend import Trend, trends_of
from testkit.hostile.foreign_logs import SURVEY, with_survey

FIRST = datetime(2020, 1, 15, tzinfo=UTC)
NOW = datetime(2060, 1, 1, tzinfo=UTC)
QUARTER = timedelta(days=91)


def series_of(store: Store, machine: str = "", software: str = "") -> tuple[Series, ...]:
    """Return the series of a store whose tables are all whole. Raises DataError with the name of
    one that is not."""
    history = history_in(store, NOW, machine, software)
    for left in history.left_out:
        if left.damaged:
            raise DataError(left.name, expected="a whole table", found=left.why)
    return history.series


def trend_of(series: Series, tolerance: float | None = None) -> Trend:
    """Return the trend of one series alone."""
    return trends_of([series], lambda *_: tolerance)[0]


def made_series(
    values: list[float],
    *,
    u: float | None = 0.5,
    quantity: str = RMS,
    common: float = 0.0,
    surveys: tuple[Survey, ...] | None = None,
    days: float = 91.0,
) -> Series:
    """Return one number of a machine over time, a survey a quarter; ``common`` is the share of u
    that all surveys have in common."""
    count, known = len(values), np.nan if u is None else u
    if surveys is None:
        surveys = tuple(
            Survey(time=FIRST + number * timedelta(days=days), name=str(number))
            for number in range(count)
        )
    at = np.array(values, dtype=float)[:, None]
    shown = np.column_stack([at, np.full(count, known), np.full((count, 2), np.nan)])
    return Series(
        machine="M",
        quantity=quantity,
        unit="um",
        surveys=surveys,
        nodes_mm=np.zeros(1),
        values=at,
        u=np.full((count, 1), known),
        common=np.full(count, common),
        shown=shown,
    )


def finished_survey(folder: Path, machine: str = "Mill 7/ä", event: str = "") -> Path:
    """Record and complete one short survey; return its folder."""
    text = SURVEY.replace('machine = "virtual"', f'machine = "{machine}"\nevent = "{event}"')
    text = text[: text.index("[[export]]")]
    target = folder / "0001"
    target.mkdir(parents=True)
    log = target / "0001.mcap"
    log.write_bytes(with_survey(text))
    complete([log], target)
    return target


def write_rounds(folder: Path, squareness: Sequence[float], tolerance: float | None) -> None:
    """Write a result a quarter, each with its C0Y in µrad, U 0.2."""
    made = folder / "0001" if (folder / "0001").exists() else finished_survey(folder)
    first = parse_result((made / RESULT).read_text(encoding="utf-8"), "made")
    for number, value in enumerate(squareness):
        moment = (FIRST + number * QUARTER).strftime("%Y-%m-%d %H:%M UTC")
        assert first.survey is not None
        facts = replace(first.survey, begun=moment, ended=moment)
        result = replace(
            first,
            survey=facts,
            squareness=first.squareness
            | {"C0Y": replace(first.squareness["C0Y"], value=value, u=0.1)},
            findings=(),
        )
        target = folder / f"{number + 1:04d}"
        target.mkdir(exist_ok=True)
        judged = (
            result
            if tolerance is None
            else with_tolerance(result, {"squareness_urad": tolerance})
        )
        for old in target.glob(f"{RESULT}*"):
            old.unlink()
        write_hashed(target / RESULT, judged.to_json())


def write_history(
    store: Store,
    machine: str,
    values: list[float],
    *,
    u: float = 0.5,
    quantity: str = RMS,
    events: dict[int, str] | None = None,
) -> list[datetime]:
    """Put one number a quarter into a store as if it had been archived; return the times."""
    times = [FIRST + number * timedelta(days=91) for number in range(len(values))]
    for number, (time, value) in enumerate(zip(times, values, strict=True)):
        survey = f"{number:016x}"
        about = About(
            machine=machine,
            survey=survey,
            time=time,
            event=(events or {}).get(number, ""),
            method="estimate",
            software="1",
            conditions="{}",
        )
        rows = [
            Row(quantity=quantity, axis="", position_mm=None, value=value, u=u, unit="um")
        ]
        put_table(
            store,
            Place(machine, str(time.year), survey),
            {RESULT: "0" * 64},
            to_parquet(table_of(about, rows)),
        )
    return times


def whole_result_rows(dice: np.random.Generator, drift: float, nodes: int = 11) -> list[Row]:
    """Return the rows of a result with all 18 functions, as many numbers as a usual survey has."""
    rows = [
        Row(quantity=RMS, axis="", position_mm=None, value=abs(5 + drift), u=0.5, unit="um")
    ]
    for axis in "XYZ":
        for component in "XYZABC":
            values = np.cumsum(dice.normal(0, 1, nodes)) + drift
            rows += [
                Row(
                    quantity=f"E{component}{axis}",
                    axis=axis,
                    position_mm=100.0 * at,
                    value=round(float(value), 6),
                    u=0.4,
                    unit="um",
                )
                for at, value in enumerate(values)
            ]
    return rows
