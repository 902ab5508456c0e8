"""The text of uMD lines: blocks of bytes to rows of whole numbers.

`parse_line` defines the conversion of a line. numpy converts a block as a whole thirty times
faster, but only if all its lines have the same plain form; any other block is halved until the
irregular line is alone.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Words, message
from stepdiag.daq.formats.framing.lines import quote

Rows = NDArray[np.int64]
"""Lines of one form, shape (lines, 8) or (lines, 16)."""

LINE_CAP = 1024
"""Longest line in bytes: sixteen fields of 19 characters are 320 bytes; debug lines may be longer.
"""

_SINGLE_AXIS, _MULTI_AXIS = 8, 16
_INTEGER = rb"-?[0-9]+"
_LINE = re.compile(rb"\s*%b(?:\s+%b){7}(?:(?:\s+%b){8})?\s*" % (_INTEGER, _INTEGER, _INTEGER))
"""A line of whole numbers with any number of blanks around the numbers: uMD2 v2.47r sends a blank
after the 16 fields.
"""
_BANNER = re.compile(rb"[A-Za-z][ -~]{3,}")
"""Printable text that begins with a letter: a uMD0 starts with "Minimalist Homodyne Test:"."""

_NUMERALS = b"0123456789-"
_MINUS, _BLANK, _ZERO = b"- 0"
_LIMIT = 10**18
"""Limit of the numbers: counts of a board are far smaller, and numbers below this limit fit int64.
"""
_PADDING = b"0" * 40
"""Leading zeros. A line of 16 numbers below `_LIMIT` exceeds `LINE_CAP` only if a number begins
with at least 40 zeros.
"""
_SMALL_BLOCK = 200
"""Size of a block in bytes; a smaller block is converted faster line by line."""


@dataclass(frozen=True, slots=True)
class OddLine:
    """A line without a sample."""

    code: Literal["banner", "debug", "garbage"]
    why: Words


def parse_lines(block: bytes) -> Iterator[Rows | OddLine]:
    """Yield the rows of numbers and the lines without a sample (`OddLine`) of ``block`` in order.
    ``block`` is empty or ends with a line feed. Empty lines are skipped.
    """
    rows = uniform_rows(block) if len(block) > _SMALL_BLOCK else None
    if rows is not None:
        yield rows
        return
    middle = block.find(b"\n", len(block) // 2, len(block) - 1) + 1
    if middle and len(block) > _SMALL_BLOCK:
        yield from parse_lines(block[:middle])
        yield from parse_lines(block[middle:])
        return
    for line in block[:-1].split(b"\n"):
        parsed = parse_line(line)
        if parsed is not None:
            yield parsed


def parse_line(line: bytes) -> Rows | OddLine | None:
    """Return the row of numbers of a line, or an `OddLine` for a line without a sample; None for an
    empty line.
    """
    if len(line) <= LINE_CAP:
        if _LINE.fullmatch(line):
            numbers = [int(field) for field in line.split()]
            if -_LIMIT < min(numbers) <= max(numbers) < _LIMIT:
                return np.array([numbers], dtype=np.int64)
        text = line.strip()
        if not text:
            return None
        if text.startswith(b"!"):
            return OddLine(
                "debug", text[1:].decode("ascii", errors="backslashreplace").strip()
            )
        if _BANNER.fullmatch(text):
            return OddLine("banner", text.decode("ascii"))
    return OddLine("garbage", message("line-no-sample", quoted=quote(line)))


def uniform_rows(block: bytes) -> Rows | None:
    """Return the rows of a block whose lines all have 8 or all have 16 plain fields; None for any
    other block.
    """
    first = block[: block.find(b"\n") + 1]
    fields = len(first.split())
    separators = first.translate(None, _NUMERALS)
    if fields not in (_SINGLE_AXIS, _MULTI_AXIS) or separators.rstrip(b"\r\n") not in (
        b" " * (fields - 1),
        b" " * fields,
    ):
        return None
    found = block.translate(None, _NUMERALS)
    lines, rest = divmod(len(found), len(separators))
    if rest or found != separators * lines or _PADDING in block or not _plain_signs(block):
        return None
    numbers: Rows = np.fromstring(block, dtype=np.int64, sep=" ")
    if (
        len(numbers) != lines * fields
        or not -_LIMIT < int(numbers.min()) <= int(numbers.max()) < _LIMIT
    ):
        return None  # there are fewer numbers than fields: a field is empty
    return numbers.reshape(lines, fields)


def _plain_signs(block: bytes) -> bool:
    characters = np.frombuffer(block, dtype=np.uint8)
    minus = characters == _MINUS
    after_none = minus[1:] & (characters[:-1] > _BLANK)
    before_none = minus[:-1] & (characters[1:] < _ZERO)
    return not (after_none | before_none).any()
