"""CSV tables with comments, blank lines or a byte order mark; every error message contains the
line."""

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message

LARGEST = 1e12
"""Largest magnitude of a number in a table: every position, error, time and count of a machine is
smaller, and its square is still finite."""
MOST_ROWS = 2_000_000
"""Largest number of rows of a table: a stability test of half an hour with the fastest head gives
fewer rows."""


def read_table(
    text: str,
    source: str,
    required: Sequence[str],
    alias: Mapping[str, str] | None = None,
    most_rows: int = MOST_ROWS,
) -> list[tuple[int, dict[str, str]]]:
    """Return (line number, fields by column) for every row of a CSV with a header.

    The reader accepts a byte order mark, CRLF, blank lines, and comment lines (``#``). ``alias``
    maps other spellings of column names. Raises ``DataError`` for missing or repeated columns,
    other separators, rows of different length, and tables without rows.
    """
    numbered = enumerate(text.removeprefix("\ufeff").splitlines(), start=1)
    content = [
        (number, line)
        for number, line in numbered
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(content) < 2:
        raise DataError(
            source,
            expected=message("header-at-least-one"),
            found=message("number-of-lines", content=len(content)),
        )
    if len(content) > most_rows + 1:
        raise DataError(
            source,
            expected=message("at-most-rows", most_rows=most_rows),
            found=str(len(content) - 1),
        )
    header = _header(*content[0], source, required, alias or {})
    return [(number, _fields(number, line, header, source)) for number, line in content[1:]]


def _header(
    number: int, line: str, source: str, required: Sequence[str], alias: Mapping[str, str]
) -> list[str]:
    where = f"{source}: line {number}: header"
    if "," not in line and (";" in line or "\t" in line):
        remedy = message("save-csv-with-commas")
        raise DataError(
            where,
            expected=message("columns-separated-by-commas"),
            found=message("semicolons-tabs"),
            remedy=remedy,
        )
    names = [alias.get(name, name) for name in _split(number, line, source)]
    missing = [name for name in required if name not in names]
    if missing:
        raise DataError(
            where,
            expected=message("the-columns", names=",".join(required)),
            found=message("no-columns", names=missing),
        )
    twice = sorted(name for name, count in Counter(names).items() if count > 1 and name)
    if twice:
        raise DataError(
            where,
            expected=message("every-column-once"),
            found=message("named-twice", twice=repr(twice[0])),
        )
    return names


def _fields(number: int, line: str, header: list[str], source: str) -> dict[str, str]:
    fields = _split(number, line, source)
    if len(fields) != len(header):
        remedy = (
            message("decimal-comma-splits-number")
            if len(fields) > len(header)
            else message("row-was-cut-off")
        )
        raise DataError(
            f"{source}: line {number}",
            expected=message("number-of-fields", header=len(header)),
            found=f"{len(fields)}",
            remedy=remedy,
        )
    return dict(zip(header, fields, strict=True))


def _split(number: int, line: str, source: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line], strict=True))]
    except csv.Error as error:
        raise DataError(
            f"{source}: line {number}",
            expected=message("comma-separated-fields"),
            found=str(error),
        ) from None


def number_in(
    fields: Mapping[str, str],
    name: str,
    where: str,
    *,
    optional: bool = False,
    least: float = -math.inf,
) -> float:
    """Return the finite number in a field; NaN for an optional field that is empty or absent.
    Raises ``DataError`` for any other text."""
    text = fields.get(name, "")
    if optional and not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST or value < least:
        remedy = message("write-decimals-with-point") if "," in text else ""
        expected = message("finite-number-from-0") if least == 0 else message("finite-number")
        raise DataError(
            f"{where}: {name}", expected=expected, found=repr(text), remedy=remedy
        )
    return value


def whole_number_in(fields: Mapping[str, str], name: str, where: str, *, least: int) -> int:
    """Return the whole number in a field. Raises ``DataError`` for a number below ``least`` or any
    other text."""
    text = fields[name]
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) >= least):
        raise DataError(
            f"{where}: {name}",
            expected=message("whole-number-from-up", least=least),
            found=repr(text),
        )
    return int(text)
