"""`umd`: the line format of the interferometer displays uMD0, uMD1 and uMD2 (reference: instruments
1.A).

A line has 8 decimal integers for one axis, or 16 for three, ended by CR LF: REF, MEAS 1,
displacement 1, velocity 1, phase 1, sequence number, low-speed code, low-speed data, then MEAS,
displacement, velocity and phase of axes 2 and 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message
from stepdiag.daq.formats.framing.batch import NOTHING, Batch
from stepdiag.daq.formats.framing.checks import require, require_interferometer, require_sign
from stepdiag.daq.formats.framing.counter import CounterTrack, Wrap
from stepdiag.daq.formats.framing.lines import LineBuffer, arrivals_of_lines
from stepdiag.daq.formats.instruments.umd.board import Board
from stepdiag.daq.formats.instruments.umd.reading import Reading
from stepdiag.daq.formats.instruments.umd.rows import (
    LINE_CAP,
    OddLine,
    Rows,
    parse_line,
    parse_lines,
    uniform_rows,
)
from stepdiag.daq.timing.samples import Flag, Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class UmdSettings:
    """Settings of a uMD board.

    ``axis`` is the measurement channel 1, 2 or 3. ``optics`` is the optics factor of the
    interferometer: 1 for a single pass (retroreflector, or flat mirror with a single-aperture
    head), 2 for a plane mirror interferometer, 4 for high resolution. Positions are computed with
    the vacuum wavelength; the air index is applied later. ``latency_s`` is the delay inside the
    board (uMD1 v60: 24 sample periods). ``phase_bits`` overrides the width of the phase field that
    the firmware sends. With ``phase_bits`` None the width from the firmware is used, and a phase
    other than 0 is flagged until the firmware sends the width.
    """

    axis: int = 1
    wavelength_nm: float = 632.991
    optics: int = 1
    sign: int = 1
    latency_s: float = 0.0
    phase_bits: int | None = None

    def __post_init__(self) -> None:
        require(self.axis in (1, 2, 3), "laser.umd.axis", "1, 2 or 3", self.axis)
        require(
            self.phase_bits in (None, 8, 16),
            "laser.umd.phase_bits",
            message("phase-bits"),
            self.phase_bits,
        )
        require_interferometer(self.wavelength_nm, self.optics)
        require_sign(self.sign)


_RAW_COUNT = (
    Wrap(-(2**15), 2**15 - 1, 1000),
    Wrap(-(2**31), 2**31 - 1, 1000),
    Wrap(0, 2**32 - 1, 1000),
)
"""Ranges of the sequence number. A uMD0 prints its 32-bit number as a signed 16-bit number; the
number of a uMD1 or uMD2 wraps at 32 bits. Across the end of a range at most 1000 steps are
accepted.
"""

_REF, _SEQUENCE, _CODE, _DATA = 0, 5, 6, 7
_MEAS_DISPLACEMENT_PHASE = {1: (1, 2, 4), 2: (8, 9, 11), 3: (12, 13, 15)}


class UmdDecoder:
    """Decoder of a uMD board.

    The first line of a stream may lack its beginning: its sample gets the flag OUT_OF_RANGE,
    because DEVICE_ERROR would mean a lost count. A line without the configured axis has the
    position NaN and the flag DEVICE_ERROR. If REF is 0, the scale is unknown until the board sends
    whether the board is homodyne; until then the position is NaN with the flag HEAD_ERROR.
    """

    def __init__(self, settings: UmdSettings) -> None:
        self._settings = settings
        self._columns = _MEAS_DISPLACEMENT_PHASE[settings.axis]
        self._cycle_mm = settings.sign * settings.wavelength_nm * 1e-6 / 2 / settings.optics
        self._lines = LineBuffer(LINE_CAP)
        self._track = CounterTrack(_RAW_COUNT)
        self.repeats_after = 2.0**32
        self._board = Board(settings.phase_bits)
        self._first_line = True
        self._greeted = False
        self._remarked: set[Message] = set()
        self.nominal_rate_hz: float | None = None
        """The last sample rate in Hz that the board sent with code 8."""
        self.gaps_visible = False
        """Whether the sequence number also counts samples that the board could not send; False
        until the board sends its rate.
        """
        self.latency_s = settings.latency_s

    def resync(self) -> None:
        self._lines.skip_line()

    def feed(self, chunk: bytes, arrival_ns: int) -> Samples:
        """Return the samples of ``chunk``; positions in mm with the vacuum wavelength."""
        block = self._lines.feed(chunk)
        if not block:
            return NOTHING
        batch = Batch()
        if self._first_line:
            self._first_line = False
            block = self._take_first_line(block, batch)
        for part in parse_lines(block):
            self._take(part, batch)
        return batch.samples(arrival_ns)

    def feed_steady(self, chunks: Sequence[tuple[bytes, int]]) -> Samples | None:
        data = b"".join(chunk for chunk, _ in chunks)
        rows = None if self._greeted else uniform_rows(self._lines.preview(data))
        if rows is None or not self._goes_on(rows):
            return None
        meas, displacement, phase = self._columns
        cycles, flags = self._board.reading.interpret(
            rows[:, _REF], rows[:, meas], rows[:, displacement], rows[:, phase]
        )
        if flags.any():
            return None
        self._lines.feed(data)
        batch = Batch()
        batch.add(
            self._track.follow(rows[:, _SEQUENCE]).counter, cycles * self._cycle_mm, flags
        )
        return batch.samples(arrivals_of_lines(chunks))

    def _goes_on(self, rows: Rows) -> bool:
        return (
            rows.shape[1] > self._columns[0]
            and self._track.goes_on(rows[:, _SEQUENCE])
            and not self._news(rows)
        )

    def _news(self, rows: Rows) -> list[int]:
        """Return the indices of rows with a code; empty if every code repeats its known data, as
        most codes do.
        """
        coded = np.flatnonzero(rows[:, _CODE])
        codes = set(
            zip(rows[coded, _CODE].tolist(), rows[coded, _DATA].tolist(), strict=True)
        )
        return (
            []
            if all(self._board.knows(code, data) for code, data in codes)
            else coded.tolist()
        )

    def _take_first_line(self, block: bytes, batch: Batch) -> bytes:
        line, _, rest = block.partition(b"\n")
        part = parse_line(line)
        if part is not None:
            self._take(part, batch)
            batch.doubt(Flag.OUT_OF_RANGE)
        return rest

    def _take(self, part: Rows | OddLine, batch: Batch) -> None:
        if isinstance(part, OddLine):
            self._greeted |= part.code == "banner"
            batch.note(part.code, part.why)
            return
        followed = self._track.follow(part[:, _SEQUENCE], restarted=self._greeted)
        self._greeted = False
        earlier = len(batch.notices)
        batch.remark(followed.breaks, followed.keep)
        self._take_rows(
            part if followed.keep.all() else part[followed.keep], followed.counter, batch
        )
        batch.notices[earlier:] = sorted(
            batch.notices[earlier:], key=lambda notice: notice.index
        )

    def _take_rows(self, rows: Rows, counter: NDArray[np.int64], batch: Batch) -> None:
        """Add ``rows`` to the batch in parts: a part ends where a code changes the decoding of
        lines.
        """
        first, base = 0, batch.count
        reading = self._board.reading
        for row in self._news(rows):
            remark = self._board.hear(int(rows[row, _CODE]), int(rows[row, _DATA]))
            if remark is not None:
                batch.note(
                    remark.code,
                    remark.why,
                    value=remark.value,
                    name=remark.name,
                    index=base + row,
                )
            if self._board.reading is not reading:
                self._read(rows[first:row], counter[first:row], reading, batch)
                first, reading = row, self._board.reading
                self.nominal_rate_hz, self.gaps_visible = (
                    self._board.rate_hz,
                    self._board.counts_every_sample,
                )
        self._read(rows[first:], counter[first:], reading, batch)

    def _read(
        self, rows: Rows, counter: NDArray[np.int64], reading: Reading, batch: Batch
    ) -> None:
        meas, displacement, phase = self._columns
        if not len(rows):
            return
        if rows.shape[1] <= meas:
            self._remark_once(
                message("lines-no-axis", axis=self._settings.axis), batch.count, batch
            )
            batch.add(
                counter,
                np.full(len(rows), np.nan),
                np.full(len(rows), Flag.DEVICE_ERROR, dtype=np.uint16),
            )
            return
        if reading.phase_use == "unknown" and rows[:, phase].any():
            where = batch.count + int(np.flatnonzero(rows[:, phase])[0])
            self._remark_once(message("phase-width"), where, batch)
        cycles, flags = reading.interpret(
            rows[:, _REF], rows[:, meas], rows[:, displacement], rows[:, phase]
        )
        cycles *= self._cycle_mm
        batch.add(counter, cycles, flags)

    def _remark_once(self, why: Message, index: int, batch: Batch) -> None:
        if why not in self._remarked:
            self._remarked.add(why)
            batch.note("device", why, index=index)
