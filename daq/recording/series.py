"""A time series of positions from another program: CARTO Dynamic's ``.rtx``, or a CSV table.

An ``.rtx`` file has text lines ``key: value`` with CRLF, a line ``Data:``, little-endian float64
numbers, and ``EOF::``. No maker's document is public; the source is a public reader and the header
of its sample (TanmayPani/rtx2csv @c2571a0, 2025-11). The header contains no unit, so the owner of a
series must state the unit.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector

MM = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}
"""Millimetres of each possible unit of a series."""
HEADER, DATA, END = b"HEADER::", b"Data:\r\n", b"EOF::"
LONGEST_HEADER = 65_536
STEADY = 0.5
"""Largest deviation of the time of a row, as a share of a sample period. A larger deviation is a
missing sample, and the series is refused.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A series of positions in mm, shape (N,), with ``rate_hz`` positions per second."""

    position_mm: Vector
    rate_hz: float

    def at_rate(self, rate_hz: float) -> "Series":
        """Return the means of equal blocks, with a rate of at most ``rate_hz``; an incomplete last
        block is left out.
        """
        size = max(1, int(np.ceil(self.rate_hz / rate_hz - 1e-9)))
        whole = len(self.position_mm) // size * size
        return Series(
            self.position_mm[:whole].reshape(-1, size).mean(axis=1), self.rate_hz / size
        )


def parse_rtx(data: bytes, unit: str, source: str) -> Series:
    """Return the series of an ``.rtx`` file. Raises DataError for another kind of file, a file that
    was cut off, or an invalid position.
    """
    if not data.startswith(HEADER):
        raise DataError(
            source, expected=message("rtx-header"), found=repr(data[:20].decode("latin-1"))
        )
    begin = data.find(DATA, 0, LONGEST_HEADER)
    end = data.rfind(END)
    if begin < 0 or end < begin:
        raise DataError(
            source,
            expected=message("rtx-data"),
            found=message("none"),
            remedy=message("file-was-cut-off"),
        )
    begin += len(DATA)
    lines = data[:begin].decode("utf-8", "replace").splitlines()
    fields = {
        key.strip().lower(): value.strip()
        for key, colon, value in (line.partition(": ") for line in lines)
        if colon
    }
    where = f"{source}: Actual sample rate"
    rate_hz = number_in(
        {"rate": fields.get("actual sample rate", "")}, "rate", where, least=0.0
    )
    body = data[begin:end]
    if len(body) % 8 or not rate_hz:
        raise DataError(
            source,
            expected=message("rtx-whole"),
            found=message("number-of-bytes", count=len(body)),
        )
    return _checked(
        np.frombuffer(body, dtype="<f8").astype(np.float64) * MM[unit], rate_hz, source
    )


def parse_csv_series(text: str, unit: str, source: str) -> Series:
    """Return the series of a CSV table with the columns ``time_s`` and ``position``.

    Raises DataError for a table with other columns, for times that do not rise, and for a missing
    sample.
    """
    rows = [
        (f"{source}: line {line}", fields)
        for line, fields in read_table(text, source, ("time_s", "position"))
    ]
    times = np.array([number_in(fields, "time_s", where) for where, fields in rows])
    positions = np.array([number_in(fields, "position", where) for where, fields in rows])
    steps = np.diff(times)
    usual_s = float(np.median(steps)) if len(steps) else 0.0
    if not usual_s > 0.0:
        raise DataError(
            f"{source}: time_s",
            expected=message("times-that-rise"),
            found=message("other-ones"),
        )
    wrong = np.flatnonzero(np.abs(steps - usual_s) > STEADY * usual_s)
    if len(wrong):
        where = f"{rows[int(wrong[0]) + 1][0]}: time_s"
        raise DataError(
            where,
            expected=message("sample-period", period_s=usual_s),
            found=f"{float(steps[wrong[0]]):g} s",
        )
    return _checked(
        positions * MM[unit], (len(times) - 1) / float(times[-1] - times[0]), source
    )


def _checked(position_mm: Vector, rate_hz: float, source: str) -> Series:
    if len(position_mm) < 2 or not np.isfinite(position_mm).all():
        raise DataError(
            source, expected=message("finite-positions"), found=message("other-ones")
        )
    return Series(position_mm, rate_hz)
