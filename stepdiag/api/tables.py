"""Tables for notebooks: readings, stops, samples, values or findings, one row each.

`table` returns plain lists; `frame` returns a pandas DataFrame (``stepdiag[notebook]``).
"""

from collections.abc import Iterable, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from stepdiag.api.recorded import RecordedLog
from stepdiag.base.errors import UsageError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import message
from stepdiag.base.names import AXES
from stepdiag.base.readings.readings import Readings
from stepdiag.base.result.result import Result
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.timing.samples import Samples

if TYPE_CHECKING:
    import pandas as pd

Table = dict[str, list[Any]]
_OF_A_STOP = (
    "setup",
    "outward",
    "stop",
    "reading_mm",
    "u_um",
    "scatter_um",
    "slope_um_s",
    "samples",
    "rejected",
    "time_s",
    "beam",
)
_OF_A_FINDING = (
    "code",
    "severity",
    "action",
    "setup",
    "pass_number",
    "stop",
    "size_um",
    "text",
)


@singledispatch
def table(of: object) -> Table:
    """Return an object of the API as columns of equal length. The object is a set of readings, the
    stops or the samples of a log, a result, or findings.

    A result gives one row per value of a function: name, unit, position_mm, value, u. Samples have
    the columns of `daq.timing.samples.Samples` except ``channels``. The column ``counter`` is the
    clock of the instrument. Raises UsageError for any other type.
    """
    expected = message(
        "one-of", names=("Readings", "RecordedLog", "Samples", "Result", "Finding")
    )
    raise UsageError("table", expected=expected, found=type(of).__name__)


@table.register
def _(of: Readings) -> Table:
    columns: Table = {
        "setup": list(of.setup),
        "pass": of.pass_number.tolist(),
        "stop": of.stop.tolist(),
    }
    columns |= {
        f"{axis}_mm": of.position_mm[:, index].tolist() for index, axis in enumerate(AXES)
    }
    return columns | {
        name: getattr(of, name).tolist()
        for name in ("reading_mm", "u_um", "temperature_c", "time_s")
    }


@table.register
def _(of: RecordedLog) -> Table:
    return table(of.stops)


@table.register
def _(of: Samples) -> Table:
    return {
        name: getattr(of, name).tolist()
        for name in ("counter", "position_mm", "beam", "flags", "arrival_ns")
    }


@table.register
def _(of: Result) -> Table:
    rows = [
        (name, function.unit, position, value, u)
        for name, function in of.errors.items()
        if function.value is not None
        for position, value, u in zip(
            function.position_mm,
            function.value,
            _or_nan(function.u, len(function.value)),
            strict=True,
        )
    ]
    return _columns(("name", "unit", "position_mm", "value", "u"), rows)


@table.register(tuple)
@table.register(list)
def _(of: Sequence[CapturedStop | Finding]) -> Table:
    if any(isinstance(each, Finding) for each in of):
        return _columns(
            _OF_A_FINDING, ([getattr(each, name) for name in _OF_A_FINDING] for each in of)
        )
    columns = _columns(
        _OF_A_STOP, ([getattr(each, name) for name in _OF_A_STOP] for each in of)
    )
    at_mm = [each.position_mm for each in of if isinstance(each, CapturedStop)]
    return columns | {
        f"{axis}_mm": [each[index] for each in at_mm] for index, axis in enumerate(AXES)
    }


def frame(of: object) -> "pd.DataFrame":
    """Return the columns of `table` as a DataFrame. Raises UsageError without pandas, and the
    errors of `table`."""
    try:
        import pandas as pd
    except ImportError:
        raise UsageError(
            "frame",
            expected="pandas",
            found=message("nothing"),
            remedy=message("do-install", extra="notebook"),
        ) from None
    return pd.DataFrame(table(of))


def _columns(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> Table:
    rows = list(rows)
    return {name: [row[index] for row in rows] for index, name in enumerate(names)}


def _or_nan(values: Any, count: int) -> Any:
    return np.full(count, np.nan) if values is None else values
