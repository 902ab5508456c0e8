"""The times at which the figures of a machine leave their tolerances, from the rounds of its survey
(`stepdiag.fleet.trend`).

The module does not use Apache Arrow, because Arrow reserves a gigabyte, which is the memory limit
of this process.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.base.result.result import Result, result_in
from stepdiag.daq.recording.rounds import round_folders
from stepdiag.daq.records.survey_folder import RESULT
from stepdiag.fleet.rows import about, rows_of
from stepdiag.fleet.series import (
    OF_VOLUME,
    Series,
    Survey,
    by_volume,
    middle_of,
    parted,
    stated,
)
from stepdiag.fleet.trend import Trend, trends_of


def leavings(folder: Path, now: datetime) -> list[Trend]:
    """Return the series with a date at which they leave a tolerance of the last result; a round
    with an unreadable result is left out."""
    found = list(_results(folder))
    judged = found[-1][1].conformity if found else None
    if judged is None:
        return []
    tolerances = {each.quantity.replace("_", "-"): each.tolerance for each in judged.as_found}
    groups, _ = parted("", dict(enumerate(survey for survey, _ in found)), now)
    alike = [found[at] for at in groups[0][0]] if groups else []
    series = [
        each
        for quantity in tolerances
        for each in _series(quantity, alike)
        if each.other is None
    ]
    trends = trends_of(series, lambda _, quantity: tolerances.get(quantity))
    return [
        each
        for each in trends
        if each.leaving is not None and each.leaving.likely is not None
    ]


def _series(quantity: str, found: Sequence[tuple[Survey, Result]]) -> Iterator[Series]:
    stating = [
        (survey, row)
        for survey, result in found
        for row in rows_of(result)
        if row.quantity == quantity
    ]
    if stating:
        rows = [row for _, row in stating]
        shown = np.array(
            [
                [
                    row.value,
                    *(
                        math.nan if each is None else each
                        for each in (row.u, row.low, row.high)
                    ),
                ]
                for row in rows
            ]
        )
        whole = Series(
            machine="",
            quantity=quantity,
            unit=rows[0].unit,
            surveys=tuple(survey for survey, _ in stating),
            nodes_mm=np.zeros(1),
            values=middle_of(shown),
            u=shown[:, 1:2],
            common=np.array(
                [(row.u_common or 0.0) / row.u if row.u else 0.0 for row in rows]
            ),
            shown=shown,
        )
        yield from by_volume(whole) if quantity in OF_VOLUME else (whole,)


def _results(folder: Path) -> Iterator[tuple[Survey, Result]]:
    with suppress(OSError):
        for each in round_folders(folder):
            with suppress(StepdiagError, OSError):
                result = result_in(each / RESULT, each.name)
                facts = about(result, each.name)
                active, standing = stated(facts.conditions)
                yield (
                    Survey(
                        time=facts.time,
                        name=each.name,
                        event=facts.event,
                        active=active,
                        standing=standing,
                    ),
                    result,
                )
