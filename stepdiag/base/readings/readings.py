"""The table of readings, one row per stop, and its CSV form (contract 4)."""

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.csv_table import number_in, read_table, whole_number_in
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.base.setups import SETUP_NAMES, setup_of
from stepdiag.base.volume import Vector, reads_like_metres

REQUIRED = ("setup", "pass", "stop", "x_mm", "y_mm", "z_mm", "reading_mm")
MOST_READINGS = 300_000
"""Largest number of rows in a table of readings: 200 setups of the largest volume, out and back. A
row needs a kilobyte of memory."""
OPTIONAL = ("u_um", "temperature_c", "time_s")
ZERO = "zero"
AT_20_C = "at_20_c"
"""Column of a table of readings: 1 for a reading that is already reduced from ``temperature_c`` to
20 C, otherwise 0 or empty."""
TURNED = "turned"
"""Column of a table of readings: 1 at the first stop of a pass if the machine reversed there, so
that the reading is the last reading of the previous pass."""
NO_ZERO = -1
"""Value of the column ``zero`` for a pass with its own zero: each reading is relative to the first
stop of its pass."""
BEAM = ("beam_x_mm", "beam_y_mm", "beam_z_mm")
MOST_MISSING = 0.1
"""Largest share of missing stops with which a pass can still be solved."""


class PassKey(NamedTuple):
    setup: str
    number: int

    @property
    def outward(self) -> bool:
        """Return whether the pass is an outward pass (odd number)."""
        return self.number % 2 == 1

    @property
    def place(self) -> str:
        """Return the pass as a short text: ``ppp/1``."""
        return f"{self.setup}/{self.number}"

    @property
    def words(self) -> Message:
        return message("pass-of-setup", setup=self.setup, number=self.number)

    def __str__(self) -> str:
        return str(self.words)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Readings:
    """Readings as columns of equal length N, one row per stop.

    ``zero`` is the number of a stretch of unbroken laser count: readings of a setup with the same
    ``zero`` are relative to the first row of the stretch. With `NO_ZERO`, readings are relative to
    the first stop of their pass. ``u_um`` (standard uncertainty of the reading), ``temperature_c``
    (material) and ``time_s`` are NaN if unknown. ``beam_mm`` (N, 3) is a point of the beam line in
    machine coordinates, NaN if the beam runs through the first commanded position of the pass.
    ``at_20_c`` is true for a reading that is already reduced to 20 C. ``turned`` is true for a
    reading that is also the last reading of the previous pass: the axes then reached the stop from
    the other side, and stay on this side until they move.
    """

    setup: tuple[str, ...]
    pass_number: NDArray[np.int64]
    stop: NDArray[np.int64]
    position_mm: Vector
    reading_mm: Vector
    u_um: Vector
    temperature_c: Vector
    time_s: Vector
    beam_mm: Vector
    zero: NDArray[np.int64]
    at_20_c: NDArray[np.bool_]
    turned: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.setup)

    def passes(self) -> dict[PassKey, NDArray[np.int64]]:
        """Return the rows of every pass in the order of its stops. The passes are in the order of
        `SETUP_NAMES`, then by number.

        Raises ``UsageError`` for an unknown setup name.
        """
        names = sorted(dict.fromkeys(self.setup), key=lambda name: setup_of(name).order)
        place = {name: index for index, name in enumerate(names)}
        setup = np.array([place[name] for name in self.setup], dtype=np.int64)
        order = np.lexsort((self.stop, self.pass_number, setup))
        begins = (
            np.flatnonzero(
                (np.diff(setup[order]) != 0) | (np.diff(self.pass_number[order]) != 0)
            )
            + 1
        )
        parts = np.split(order, begins) if len(order) else []
        return {
            PassKey(self.setup[rows[0]], int(self.pass_number[rows[0]])): rows
            for rows in parts
        }

    def select(self, rows: NDArray[np.int64] | Sequence[int]) -> "Readings":
        index = np.asarray(rows, dtype=np.int64)
        return Readings(
            setup=tuple(self.setup[row] for row in index.tolist()),
            pass_number=self.pass_number[index],
            stop=self.stop[index],
            position_mm=self.position_mm[index],
            reading_mm=self.reading_mm[index],
            u_um=self.u_um[index],
            temperature_c=self.temperature_c[index],
            time_s=self.time_s[index],
            beam_mm=self.beam_mm[index],
            zero=self.zero[index],
            at_20_c=self.at_20_c[index],
            turned=self.turned[index],
        )


def make_readings(  # noqa: PLR0913 - one argument a column
    *,
    setup: Sequence[str],
    pass_number: Sequence[int] | NDArray[np.int64],
    stop: Sequence[int] | NDArray[np.int64],
    position_mm: Sequence[Sequence[float]] | Vector,
    reading_mm: Sequence[float] | Vector,
    u_um: Sequence[float] | Vector | None = None,
    temperature_c: Sequence[float] | Vector | None = None,
    time_s: Sequence[float] | Vector | None = None,
    beam_mm: Sequence[Sequence[float]] | Vector | None = None,
    zero: Sequence[int] | NDArray[np.int64] | None = None,
    at_20_c: Sequence[bool] | NDArray[np.bool_] | None = None,
    turned: Sequence[bool] | NDArray[np.bool_] | None = None,
) -> Readings:
    """Return readings from columns. Without ``zero``, the column contains `NO_ZERO`. Without
    ``at_20_c`` or ``turned``, the column is False. All other omitted columns are NaN. Raises
    ``ValueError`` for columns of different lengths."""
    count = len(setup)
    return Readings(
        setup=tuple(setup),
        pass_number=np.asarray(pass_number, dtype=np.int64).reshape(count),
        stop=np.asarray(stop, dtype=np.int64).reshape(count),
        position_mm=np.asarray(position_mm, dtype=np.float64).reshape(count, 3),
        reading_mm=np.asarray(reading_mm, dtype=np.float64).reshape(count),
        u_um=_column(u_um, count),
        temperature_c=_column(temperature_c, count),
        time_s=_column(time_s, count),
        beam_mm=np.full((count, 3), np.nan)
        if beam_mm is None
        else np.asarray(beam_mm, dtype=np.float64).reshape(count, 3),
        zero=np.full(count, NO_ZERO, dtype=np.int64)
        if zero is None
        else np.asarray(zero, dtype=np.int64).reshape(count),
        at_20_c=_flags(at_20_c, count),
        turned=_flags(turned, count),
    )


def _flags(
    values: Sequence[bool] | NDArray[np.bool_] | None, count: int
) -> NDArray[np.bool_]:
    return (
        np.zeros(count, dtype=np.bool_)
        if values is None
        else np.asarray(values, dtype=np.bool_).reshape(count)
    )


def _column(values: Sequence[float] | Vector | None, count: int) -> Vector:
    return (
        np.full(count, np.nan)
        if values is None
        else np.asarray(values, dtype=np.float64).reshape(count)
    )


def parse_readings(text: str, source: str = "readings.csv") -> Readings:
    """Return the readings of a CSV (contract 4), rows sorted by setup, pass and stop.

    The reader accepts a byte order mark, CRLF, blank lines, comment lines (``#``) and further
    columns. The column ``diagonal`` is accepted for ``setup``. Without a ``pass`` column, every row
    belongs to pass 1. The columns ``beam_x_mm, beam_y_mm, beam_z_mm`` are the beam line. Raises
    ``DataError`` with the line, or with setup, pass and stop.
    """
    required = [name for name in REQUIRED if name != "pass"]
    rows = [
        _Row.parse(f"{source}: line {number}", fields)
        for number, fields in read_table(
            text, source, required, {"diagonal": "setup"}, MOST_READINGS
        )
    ]
    readings = make_readings(
        setup=[row.setup for row in rows],
        pass_number=[row.pass_number for row in rows],
        stop=[row.stop for row in rows],
        position_mm=[row.position_mm for row in rows],
        reading_mm=[row.reading_mm for row in rows],
        beam_mm=[row.beam_mm for row in rows],
        zero=[row.zero for row in rows],
        at_20_c=[row.at_20_c for row in rows],
        turned=[row.turned for row in rows],
        **{
            name: [row.optional[index] for row in rows] for index, name in enumerate(OPTIONAL)
        },
    )
    passes = readings.passes()
    _refuse_gaps(readings, passes, source)
    _refuse_half_zeros(readings, passes, source)
    return readings.select(np.concatenate(list(passes.values())))


def in_mm(readings: Readings, source: str) -> Readings:
    """Check the unit of readings from another program and return the readings. Raises ``DataError``
    for a volume so small that its unit must be metres."""
    size_mm = np.ptp(readings.position_mm, axis=0)
    if reads_like_metres(size_mm.tolist()):
        found = " x ".join(f"{each:g}" for each in size_mm)
        remedy = message("reads-like-metres")
        raise DataError(
            f"{source}: x_mm, y_mm, z_mm",
            expected=message("in-mm"),
            found=message("volume-of", size=found),
            remedy=remedy,
        )
    return readings


class _Row(NamedTuple):
    setup: str
    pass_number: int
    stop: int
    position_mm: list[float]
    reading_mm: float
    optional: list[float]
    beam_mm: list[float]
    zero: int
    at_20_c: bool
    turned: bool

    @classmethod
    def parse(cls, where: str, fields: dict[str, str]) -> "_Row":
        beam_mm = [number_in(fields, name, where, optional=True) for name in BEAM]
        if 0 < sum(map(math.isnan, beam_mm)) < 3:
            raise DataError(
                f"{where}: beam",
                expected=message("all-of", names=BEAM),
                found=message("some-empty"),
            )
        return cls(
            setup=_setup_name(fields["setup"], where),
            pass_number=whole_number_in(fields, "pass", where, least=1)
            if "pass" in fields
            else 1,
            stop=whole_number_in(fields, "stop", where, least=0),
            position_mm=[number_in(fields, name, where) for name in ("x_mm", "y_mm", "z_mm")],
            reading_mm=number_in(fields, "reading_mm", where),
            optional=[
                number_in(
                    fields,
                    name,
                    where,
                    optional=True,
                    least=0.0 if name == "u_um" else -math.inf,
                )
                for name in OPTIONAL
            ],
            beam_mm=beam_mm,
            zero=whole_number_in(fields, ZERO, where, least=0)
            if fields.get(ZERO, "")
            else NO_ZERO,
            at_20_c=_yes_or_no(fields, AT_20_C, where),
            turned=_yes_or_no(fields, TURNED, where),
        )


def _yes_or_no(fields: dict[str, str], name: str, where: str) -> bool:
    text = fields.get(name, "")
    if text not in ("", "0", "1"):
        raise DataError(f"{where}: {name}", expected=message("one-or-zero"), found=repr(text))
    return text == "1"


def _setup_name(name: str, where: str) -> str:
    try:
        return setup_of(name, names=SETUP_NAMES).name
    except UsageError as error:
        raise DataError(
            f"{where}: setup", expected=error.expected, found=error.found, remedy=error.remedy
        ) from None


def _refuse_gaps(
    readings: Readings, passes: Mapping[PassKey, NDArray[np.int64]], source: str
) -> None:
    for key, rows in passes.items():
        stops = readings.stop[rows]
        where = f"{source}: {key}"
        twice = np.flatnonzero(np.diff(stops) == 0)
        if len(twice):
            remedy = message("own-number")
            raise DataError(
                where,
                expected=message("stop-once", stop=stops[twice[0]]),
                found=message("it-twice"),
                remedy=remedy,
            )
        if stops[0] != 0:
            raise DataError(
                where,
                expected=message("first-stop"),
                found=message("in-place", stop=stops[0]),
                remedy=message("relative-to-first"),
            )
        missing = int(stops[-1]) + 1 - len(stops)
        if missing > max(1, int(MOST_MISSING * len(stops))):
            first = int(stops[int(np.argmax(np.diff(stops) > 1))]) + 1
            found = message("of-missing", count=missing, all=int(stops[-1]) + 1, stop=first)
            expected = message("one-in", count=round(1 / MOST_MISSING))
            raise DataError(
                where, expected=expected, found=found, remedy=message("drive-again")
            )


def missing_stops(stops: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the missing numbers between ascending stops."""
    return np.setdiff1d(np.arange(int(stops[-1])), stops)


def _refuse_half_zeros(
    readings: Readings, passes: Mapping[PassKey, NDArray[np.int64]], source: str
) -> None:
    """Refuse a pass in which only some of the readings have a ``zero`` number, because the zero of
    the other readings is unknown."""
    for key, rows in passes.items():
        without = readings.zero[rows] == NO_ZERO
        if without.any() and not without.all():
            stop = readings.stop[rows[int(np.argmax(without))]]
            where = message("place-stop", run=f"{source}: {key}", stop=stop)
            remedy = message("number-stretches")
            expected = message("in-column", name=ZERO)
            raise DataError(where, expected=expected, found=message("none"), remedy=remedy)


def render_readings(readings: Readings) -> str:
    """Return the CSV of contract 4 without its empty columns, LF line ends. The same readings give
    the same bytes.

    Positions are written to 0.1 nm, readings to 1 pm, all other numbers to six decimals.
    """
    optional = {
        name: getattr(readings, name)
        for name in OPTIONAL
        if np.isfinite(getattr(readings, name)).any()
    }
    beam = np.isfinite(readings.beam_mm).any()
    zeros = bool(np.any(readings.zero != NO_ZERO))
    out = io.StringIO()
    flags = {
        name: column
        for name, column in ((AT_20_C, readings.at_20_c), (TURNED, readings.turned))
        if column.any()
    }
    header = (
        *REQUIRED,
        *optional,
        *((ZERO,) if zeros else ()),
        *(BEAM if beam else ()),
        *flags,
    )
    out.write(",".join(header) + "\n")
    for row in _ordered_rows(readings):
        fields = [
            readings.setup[row],
            str(readings.pass_number[row]),
            str(readings.stop[row]),
        ]
        fields += [_decimal(value, 7) for value in readings.position_mm[row]]
        fields.append(_decimal(readings.reading_mm[row], 9))
        fields += [_decimal(column[row], 6) for column in optional.values()]
        if zeros:
            fields.append("" if readings.zero[row] == NO_ZERO else str(readings.zero[row]))
        fields += [_decimal(value, 7) for value in readings.beam_mm[row]] if beam else []
        fields += [str(int(column[row])) for column in flags.values()]
        out.write(",".join(fields) + "\n")
    return out.getvalue()


def _ordered_rows(readings: Readings) -> Iterator[int]:
    for rows in readings.passes().values():
        yield from rows.tolist()


def _decimal(value: float, places: int) -> str:
    if math.isnan(value):
        return ""
    text = f"{value:.{places}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
