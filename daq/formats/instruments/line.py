"""`line`: any instrument that sends an ASCII line per sample; the survey file describes the line.

A regular expression with the named groups ``position``, ``counter`` and ``beam`` selects the
numbers of the line. RE2 matches in a time linear in the length of the line, so no line can delay
the recording; RE2 refuses looking ahead or behind and references to groups.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import re2
from numpy.typing import NDArray

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import NOTHING, Batch, judge_beam
from stepdiag.daq.formats.framing.checks import require, require_interferometer, require_sign
from stepdiag.daq.formats.framing.counter import LONGEST_WRAP_GAP, CounterTrack, Wrap
from stepdiag.daq.formats.framing.lines import LINE_CAP, LineBuffer, arrivals_of_lines, quote
from stepdiag.daq.formats.framing.units import Unit, mm_per_unit
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSettings:
    """Format of a line and meaning of its numbers.

    ``pattern`` must match the whole line without its terminator. The group ``position`` is
    required; the groups ``counter`` and ``beam`` are optional. Position in mm = number x ``scale``
    x ``unit``; the unit ``counts`` is half a vacuum wavelength divided by ``optics``.
    ``counter_modulus`` is the number of values of the counter before the counter repeats (None:
    never); the counter may be signed. The beam strength is the number of ``beam`` divided by
    ``beam_full``. The beam is lost below ``beam_threshold`` (0 to 1), and weak below twice
    ``beam_threshold``. ``rate_hz`` is the sample rate from the data sheet, None if unknown.
    """

    pattern: str
    unit: Unit = "mm"
    scale: float = 1.0
    counter_modulus: int | None = 65536
    beam_threshold: float = 0.2
    beam_full: float = 1.0
    rate_hz: float | None = None
    encoding: str = "ascii"
    terminator: Literal["\n", "\r"] = "\n"
    wavelength_nm: float = 632.991
    optics: int = 1
    sign: int = 1
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        groups = self._groups()
        require(
            "position" in groups,
            "laser.line.pattern",
            message("named-group", group="(?P<position>...)"),
            self.pattern,
        )
        modulus = self.counter_modulus
        require(
            modulus is None or modulus > 1,
            "laser.line.counter_modulus",
            message("whole-number-from-up", least=2),
            modulus,
        )
        require(
            self.beam_full > 0,
            "laser.line.beam_full",
            message("number-above-0"),
            self.beam_full,
        )
        require(
            0 <= self.beam_threshold < 1,
            "laser.line.beam_threshold",
            message("number-below-1"),
            self.beam_threshold,
        )
        require(
            self.rate_hz is None or self.rate_hz > 0,
            "laser.line.rate_hz",
            message("number-above-0"),
            self.rate_hz,
        )
        require_interferometer(self.wavelength_nm, self.optics)
        require_sign(self.sign)

    def _groups(self) -> frozenset[str]:
        try:
            require(
                "\n".encode(self.encoding) == b"\n",
                "laser.line.encoding",
                message("encoding-extends-ascii"),
                self.encoding,
            )
        except LookupError as error:
            raise UsageError(
                "survey: laser.line.encoding",
                expected=message("encoding-such-ascii"),
                found=self.encoding,
            ) from error
        return frozenset(line_pattern(self.pattern, "survey: laser.line.pattern").groupindex)


LONGEST_QUOTE = 200
MOST_MEMORY_BYTES = 4_000_000
"""Largest memory of a pattern in bytes; a larger pattern is refused."""
SAME_LINES = 1024
"""Number of parsed lines in the cache. A faulty laser can repeat the same line, and a compressed
log can contain several such lines per byte.
"""
_NUMBER = re.compile(
    r"\s*(?P<sign>[+-]?)\s*(?P<digits>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,2})?)\s*"
)
_COUNT = re.compile(r"\s*[+-]?[0-9]{1,18}\s*")


@dataclass(frozen=True, slots=True)
class _Row:
    position: float
    count: int
    beam: float


class LineDecoder:
    """Decoder of ASCII lines that the survey file describes.

    A line that does not match, or whose counter is no number, is a garbage notice. A position that
    is no number becomes NaN, and its sample gets the flag DEVICE_ERROR. The first line of a stream
    may lack its beginning: its sample gets the flag OUT_OF_RANGE. Without a counter in the line the
    program numbers the lines, and a lost line is not noticed.
    """

    def __init__(self, settings: LineSettings) -> None:
        self._settings = settings
        self._pattern = line_pattern(settings.pattern, "survey: laser.line.pattern")
        place = self._pattern.groupindex
        self._places = [place["position"], place.get("counter"), place.get("beam")]
        self._mm = (
            settings.sign
            * settings.scale
            * mm_per_unit(settings.unit, settings.wavelength_nm, settings.optics)
        )
        self._terminator = settings.terminator.encode()
        self._lines = LineBuffer(LINE_CAP, self._terminator)
        modulus = settings.counter_modulus
        self._track = CounterTrack(
            [Wrap(0, modulus - 1, min(modulus // 2, LONGEST_WRAP_GAP))] if modulus else []
        )
        self.repeats_after = float(modulus or math.inf)
        self._parsed = lru_cache(SAME_LINES)(self._read)
        self._first_line = True
        self._number = -1
        self.nominal_rate_hz = settings.rate_hz
        self.gaps_visible = "counter" in place
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._lines.skip_line()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        block = self._lines.feed(chunk)
        if not block:
            return NOTHING
        batch = Batch()
        rows: list[_Row] = []
        for line in block[:-1].split(self._terminator):
            row = self._parse(line) if line.strip() else None
            if row is not None:
                rows.append(row)
            elif line.strip():
                self._add(rows, batch)
                rows = []
                batch.note("garbage", message("line-no-match", quoted=quote(line)))
            if self._first_line:
                self._first_line = False
                self._add(rows, batch)
                rows = []
                batch.doubt(Flag.OUT_OF_RANGE)
        self._add(rows, batch)
        return batch.samples(arrival_ns)

    def feed_steady(self, chunks: Sequence[tuple[bytes, int]]) -> Samples | None:
        data = b"".join(chunk for chunk, _ in chunks)
        block = self._lines.preview(data)
        if self._first_line or not block:
            return None
        parsed = [self._parsed(line) for line in block[:-1].split(self._terminator)]
        rows = self._numbered([each for each in parsed if each is not None])
        if rows is None or len(rows) < len(parsed) or not self._track.goes_on(_counts(rows)):
            return None
        position_mm, beam, flags = self._columns(rows)
        if flags.any():
            return None
        self._lines.feed(data)
        self._number += len(rows)
        batch = Batch()
        batch.add(self._track.follow(_counts(rows)).counter, position_mm, flags, beam=beam)
        return batch.samples(arrivals_of_lines(chunks, self._terminator))

    def _numbered(
        self, parsed: Sequence[tuple[float, str | None, float]]
    ) -> list[_Row] | None:
        rows = []
        for number, (position, counter, beam) in enumerate(parsed, self._number + 1):
            count = self._count(counter) if self.gaps_visible else number
            if count is None:
                return None
            rows.append(_Row(position, count, beam))
        return rows

    def _parse(self, line: bytes) -> _Row | None:
        parsed = self._parsed(line)
        rows = None if parsed is None else self._numbered([parsed])
        if rows is None:
            return None
        self._number += 1
        return rows[0]

    def _read(self, line: bytes) -> tuple[float, str | None, float] | None:
        try:
            text = line.decode(self._settings.encoding).strip("\r\n")
        except UnicodeDecodeError:
            return None
        found = (
            self._pattern.fullmatch(text.encode()) if len(line) <= LINE_CAP else None
        )  # RE2 works on UTF-8, so matching bytes takes half the time of matching text
        if found is None:
            return None
        fields = [None if place is None else found[place] for place in self._places]
        position, counter, beam = [
            None if value is None else value.decode() for value in fields
        ]
        return _number(position), counter, _number(beam)

    def _count(self, text: str | None) -> int | None:
        if text is None or not _COUNT.fullmatch(text):
            return None
        modulus = self._settings.counter_modulus
        return int(text) % modulus if modulus else int(text)

    def _add(self, rows: list[_Row], batch: Batch) -> None:
        if not rows:
            return
        followed = self._track.follow(_counts(rows))
        kept = [row for row, keep in zip(rows, followed.keep.tolist(), strict=True) if keep]
        batch.remark(followed.breaks, followed.keep)
        position_mm, beam, flags = self._columns(kept)
        batch.add(followed.counter, position_mm, flags, beam=beam)

    def _columns(
        self, rows: Sequence[_Row]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint16]]:
        position_mm = np.array([row.position for row in rows], dtype=np.float64) * self._mm
        beam = np.clip(
            np.array([row.beam for row in rows], dtype=np.float64) / self._settings.beam_full,
            0.0,
            1.0,
        )
        flags = np.where(np.isnan(position_mm), Flag.DEVICE_ERROR, 0).astype(np.uint16)
        judge_beam(beam, self._settings.beam_threshold, flags)
        return position_mm, beam, flags


def _counts(rows: Sequence[_Row]) -> NDArray[np.int64]:
    return np.array([row.count for row in rows], dtype=np.int64)


def line_pattern(pattern: str, where: str) -> Any:
    """Return the compiled pattern. Raises UsageError for a pattern that RE2 does not support;
    ``where`` is the field of the pattern.
    """
    options = re2.Options()
    options.log_errors = False
    options.max_mem = MOST_MEMORY_BYTES
    try:
        return re2.compile(pattern, options)
    except re2.error as error:
        why = (
            error.args[0].decode("utf-8", "replace")
            if error.args and isinstance(error.args[0], bytes)
            else str(error)
        )
        raise UsageError(
            where,
            expected=message("expression-of-re2"),
            found=f"{_shortened(pattern)} ({_shortened(why)})",
            remedy=message("re2-has-no"),
        ) from error


def _shortened(text: str) -> str:
    return repr(text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}...")


def _number(text: str | None) -> float:
    found = _NUMBER.fullmatch(text) if text is not None else None
    return float(found["sign"] + found["digits"]) if found else float("nan")
