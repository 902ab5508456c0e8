"""Lines and numbers of plain text tables, for all controls."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import DataError
from stepdiag.base.messages import Message, message
from stepdiag.base.volume import Vector
from stepdiag.exporters.files.control_file import ControlFile

MOST_LINES = 1_000_000
LONGEST_LINE = 4096
"""Longest line and largest number of lines of a text file. A lattice with a hundred points per axis
has a million short lines.
"""
_SHOWN = 60


def ascii_lines(lines: Iterable[str], newline: str = "\n") -> bytes:
    return "".join(line + newline for line in lines).encode("ascii")


def read_lines(file: ControlFile) -> Iterator[tuple[str, str]]:
    """Yield the place (``x.com: line 3``) and the text of every line, including empty lines.

    Raises ``DataError`` for bytes that are not ASCII text.
    """
    try:
        text = file.data.decode("ascii")
    except UnicodeDecodeError as error:
        raise DataError(
            file.name,
            expected=message("ascii-text"),
            found=message(
                "byte-at", byte=f"{file.data[error.start]:#04x}", place=error.start
            ),
        ) from error
    lines = text.splitlines()
    if len(lines) > MOST_LINES + 1:
        raise DataError(
            file.name, expected=message("lines-most", count=MOST_LINES), found=str(len(lines))
        )
    for number, line in enumerate(lines, start=1):
        where = f"{file.name}: line {number}"
        if len(line) > LONGEST_LINE:
            raise DataError(
                where,
                expected=message("characters-most", count=LONGEST_LINE),
                found=str(len(line)),
            )
        yield where, line


def headed_lines(file: ControlFile, header: str) -> list[tuple[str, str]]:
    """Return the place and the text of every line that is not empty, the header first.

    Raises ``DataError`` for another header.
    """
    lines = [(where, line) for where, line in read_lines(file) if line]
    if not lines or lines[0][1] != header:
        raise DataError(
            file.name,
            expected=message("header-of-words", words=header),
            found=lines[0][1] if lines else message("empty-file"),
        )
    return lines


def number_rows(file: ControlFile, header: str, expected: Message) -> Vector:
    """Return the numbers of a CSV under its header, shape (rows, columns). Empty lines are skipped.

    Raises ``DataError``, with the place, for a wrong header or a line that is not as
    ``expected``.
    """
    lines = headed_lines(file, header)
    columns = len(header.split(","))
    rows = []
    for where, line in lines[1:]:
        cells = line.split(",")
        if len(cells) != columns:
            raise DataError(where, expected=expected, found=repr(line))
        rows.append([finite(cell, where) for cell in cells])
    return np.array(rows).reshape(-1, columns)


def require_end(file: ControlFile, mark: bytes, end: bytes) -> None:
    """Raise ``DataError`` for a truncated file: it contains ``mark``, so it is from stepdiag, but
    does not end with the line ``end``.
    """
    if mark in file.data and not file.data.rstrip().endswith(end):
        raise DataError(
            file.name,
            expected=message("last-line", text=end.decode("ascii")),
            found=message("no-end"),
            remedy=message("cut-off"),
        )


def finite(text: str, where: str) -> float:
    """Return the number in ``text``. Raises ``DataError``, with the place ``where``, for infinity,
    NaN and text that is no number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        raise DataError(where, expected=message("a-number"), found=shown(text))
    return value


def whole(text: str, where: str) -> int:
    """Return the whole number in ``text``. Raises ``DataError``, with the place ``where``, for text
    that is no whole number.
    """
    try:
        value = int(text)
    except ValueError as error:
        raise DataError(where, expected=message("whole-number"), found=shown(text)) from error
    if abs(value) > LARGEST:
        raise DataError(where, expected=message("whole-held"), found=shown(text))
    return value


def shown(text: str) -> str:
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..")
