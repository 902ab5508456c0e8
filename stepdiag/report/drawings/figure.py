"""A figure of the report: a drawing, and its numbers as CSV."""

import base64
import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

from stepdiag.base.result.rounding import steady

DECIMALS = 9
"""Number of decimals in a CSV: below the resolution of any instrument, but without the last bits of
a sum, which differ between processors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A drawing (SVG) and its numbers (CSV). The value ``name`` is the stem of the CSV file. A name
    contains no spaces, because the name is part of an HTML id."""

    name: str
    title: str
    drawing: str
    table: str


def csv_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return columns as CSV with LF line ends; numbers rounded to `DECIMALS`, NaN and None as empty
    fields."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([_cell(value) for value in row])
    return out.getvalue()


def data_link(table: str) -> str:
    return "data:text/csv;charset=utf-8;base64," + base64.b64encode(table.encode()).decode()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return "" if math.isnan(value) else steady(value, DECIMALS)
    return "" if value is None else value
