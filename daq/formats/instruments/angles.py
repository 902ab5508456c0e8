"""Instruments that measure angles and send one text line per reading: Elcomat 3000 autocollimators,
Wyler levels, and instruments with a similar line.

Elcomat 3000 (dls-controls/elcomat3000 @5b459ca, elcomat3000.cpp lines 47, 164, 209, 330 to 361): a
command is a letter and a LF; `s` ends a stream, `A` begins a stream of absolute readings. A reading
is the text `type status x y` in arc-seconds, ended by a CR. Types 1 and 2 are relative readings,
types 3 and 4 absolute readings. A relative reading has another origin and is not used. The third
digit of the status is 1 if x is valid, 2 if y is valid, 3 if both are valid; the status may be
longer. Numbers have the form that C's strtod reads.

Wyler: the request is `P`; the second field of the answer is the angle, the fourth field is another
quantity. The only source of this format is CERN's use of the Zerotronic, so the survey file may
contain another pattern and unit.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stepdiag.base.messages import message
from stepdiag.daq.formats.framing.batch import Batch
from stepdiag.daq.formats.framing.checks import require
from stepdiag.daq.formats.framing.lines import LineBuffer, quote
from stepdiag.daq.formats.instruments.line import line_pattern
from stepdiag.daq.timing.samples import Flag, Samples

AngleUnit = Literal["arcsec", "urad", "mrad", "deg"]
URAD = {
    "arcsec": math.pi / 180 / 3600 * 1e6,
    "urad": 1.0,
    "mrad": 1e3,
    "deg": math.pi / 180 * 1e6,
}
NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,2})?"
ELCOMAT = (
    r"\s*3\s+[0-9][0-9](?P<valid>[0-3])[0-9]*"
    rf"\s+(?P<first>{NUMBER})\s+(?P<second>{NUMBER})\s*"
)
ELCOMAT_GREETING = "s\nA\n"
WYLER = rf"\s*[^\s,;]+[\s,;]+(?P<first>{NUMBER})(?:[\s,;].*)?"
GROUPS = ("first", "second", "valid")
_LINE_CAP = 200
_LARGEST_URAD = 1e6
"""Largest valid angle in urad: 1 rad, far beyond the ranges of these instruments."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AnglesSettings:
    """Format of a line from the angular instrument.

    ``pattern`` matches the whole line and has the group ``first``, optionally ``second`` and
    ``valid`` (1: the first angle is valid, 2: the second, 3: both). The link sends ``greeting``
    once, and ``request`` for each reading. ``request`` is empty for an instrument that sends
    without requests.
    """

    pattern: str
    unit: AngleUnit = "arcsec"
    request: str = ""
    greeting: str = ""
    poll_hz: float = 10.0
    terminator: Literal["\n", "\r"] = "\r"
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        groups = line_pattern(self.pattern, "survey: head.angles.pattern").groupindex
        require(
            "first" in groups,
            "head.angles.pattern",
            message("named-group", group="(?P<first>...)"),
            self.pattern,
        )
        require(
            set(groups) <= set(GROUPS),
            "head.angles.pattern",
            message("no-other-groups", names=GROUPS),
            sorted(groups),
        )
        require(
            0 < self.poll_hz <= 100,
            "head.angles.poll_hz",
            message("number-up-to", most=100),
            self.poll_hz,
        )
        require(
            (self.request + self.greeting).isascii(),
            "head.angles.request",
            message("plain-ascii"),
            self.request,
        )


class AnglesDecoder:
    """Decoder of an angular instrument that sends without requests.

    ``channels`` has shape (count, 1 or 2): angles in urad. Position and beam are NaN. The host
    numbers the readings.
    """

    gaps_visible = False
    nominal_rate_hz: float | None = None

    def __init__(self, settings: AnglesSettings) -> None:
        self._settings = settings
        self._pattern = line_pattern(settings.pattern, "survey: head.angles.pattern")
        self._columns = 2 if "second" in self._pattern.groupindex else 1
        self._end = settings.terminator.encode()
        self._number = 0
        self.resync()
        self.greeting = settings.greeting.encode("ascii")
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        """Discard the incomplete line. The next line may lack its beginning and still match the
        pattern.
        """
        self._lines = LineBuffer(_LINE_CAP, self._end)
        if not self._settings.request:
            self._lines.skip_line()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        """Return the readings that ``chunk`` completes. A line that is no reading is a garbage
        notice.
        """
        batch = Batch()
        for line in self._lines.feed(chunk).split(self._end)[:-1]:
            if line.strip():
                self._add(line, batch)
        return batch.samples(arrival_ns)

    def _add(self, line: bytes, batch: Batch) -> None:
        found = (
            self._pattern.fullmatch(line.decode("latin-1"))
            if len(line) <= _LINE_CAP
            else None
        )
        values = self._values(found.groupdict()) if found is not None else None
        if values is None:
            batch.note("garbage", quote(line))
            return
        flags = np.zeros(1, dtype=np.uint16)
        if not np.isfinite(values).all():
            flags[0] = np.uint16(Flag.OUT_OF_RANGE)
        batch.add(
            np.array([self._number]), np.array([np.nan]), flags, channels=values[None, :]
        )
        self._number += 1

    def _values(
        self, groups: dict[str, str | None]
    ) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
        valid = groups.get("valid") or "3"
        try:
            numbers = [float(groups[name] or "nan") for name in GROUPS[: self._columns]]
            seen = [int(valid) & 1, int(valid) & 2]
        except ValueError:
            return None
        values = np.array(
            [
                number * URAD[self._settings.unit] if ok else np.nan
                for number, ok in zip(numbers, seen, strict=False)
            ]
        )
        return None if (np.abs(values) > _LARGEST_URAD).any() else values


class AskedAnglesDecoder(AnglesDecoder):
    """Decoder of an angular instrument that answers requests."""

    def __init__(self, settings: AnglesSettings) -> None:
        super().__init__(settings)
        self.request = settings.request.encode("ascii")
        self.poll_interval_s = 1.0 / settings.poll_hz
        self.nominal_rate_hz = settings.poll_hz
