"""The bytes of lasers, without input and output: uMD boards, Heidenhain displays, any ASCII line.

The uMD boards follow the sources of their firmware. The displays ND 28x and ND 287 follow their
manuals.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from stepdiag.virtual.instruments.counting import Counting
from stepdiag.virtual.physics.error_functions import Array

Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


class Encoder(Protocol):
    rate_hz: float

    def banner(self) -> bytes:
        """Return the bytes that the board sends at power-on."""
        ...

    def skip(self, count: int) -> None: ...

    def encode(self, reading_mm: Array, beam: Flags) -> bytes:
        """Return the lines with consecutive samples: readings in mm, and whether the beam is
        present."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """The properties by which the firmwares of uMD boards differ."""

    rate_hz: float
    counts_per_cycle: int = 0
    """Quadrature counts per cycle of interference, for homodyne boards; 0 for heterodyne boards."""
    phase_steps: int = 0
    """Steps of the phase field per count: 256 or 65536; 0 for a board without a phase field."""
    code_period: int = 32
    codes: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    sequence_wrap: int = 0
    """Number at which a signed sequence number wraps: 65536 for a board that prints a 16-bit int; 0
    if the number practically never wraps."""
    banner: bytes = b""


BOARDS: dict[str, Board] = {
    "umd0": Board(
        rate_hz=244.140625,
        counts_per_cycle=4,
        code_period=256,
        codes={1: (10, 209), 13: (20, 4 * 256 + 1)},
        sequence_wrap=65536,
        banner=b"\nMinimalist Homodyne Test:\r\n",
    ),
    "umd1": Board(rate_hz=610.3515625, phase_steps=256, codes={1: (10, 6000)}),
    "umd2": Board(
        rate_hz=1000.0, phase_steps=65536, codes={1: (10, 7 << 16 | 264), 3: (112, 4)}
    ),
}
"""The uMD boards: uMD0 v09 (homodyne), uMD1 v60 (8-bit phase), uMD2 v264.07 (16-bit phase, code
112)."""

_NO_MEASUREMENT_BEAM = 0x800


class UmdBoard:
    """The lines of a uMD board: REF MEAS displacement velocity phase sequence code data, CR LF.

    ``displacement - phase / steps`` is the reading in counts of wavelength / 2 / optics (the rule
    of the maker's program). A heterodyne board that loses the beam sends MEAS 0; a homodyne board
    does not show the loss.
    """

    def __init__(
        self,
        board: Board,
        *,
        wavelength_nm: float = 632.991,
        optics: int = 1,
        rate_hz: float | None = None,
        reference_mhz: float = 20.0,
        axes: Literal[1, 3] = 1,
        environment: Mapping[int, int] | None = None,
    ) -> None:
        self._board = board
        self.rate_hz = rate_hz or board.rate_hz
        self._mm_per_count = (
            wavelength_nm * 1e-6 / 2.0 / optics / (board.counts_per_cycle or 1)
        )
        self._reference = (
            0 if board.counts_per_cycle else round(reference_mhz * 1e6 / self.rate_hz)
        )
        self._codes = {2: (8, round(self.rate_hz * 100))} | dict(board.codes)
        self._codes |= {
            20 + code: (code, value) for code, value in (environment or {}).items()
        }
        self._line = (
            "%d %d %d %d %d %d %d %d" + (" 0 0 0 0 0 0 0 0" if axes == 3 else "") + "\r\n"
        )
        self._sequence = 0
        self._last_count = 0

    def banner(self) -> bytes:
        """Return the boot text and start the sequence again."""
        self._sequence = 0
        return self._board.banner

    def skip(self, count: int) -> None:
        """Advance the sequence number: a board with a full buffer also counts the samples that it
        cannot send."""
        self._sequence += count

    def encode(self, reading_mm: Array, beam: Flags) -> bytes:
        count, phase = self._count_and_phase(reading_mm / self._mm_per_count)
        velocity = np.diff(count, prepend=self._last_count)
        doppler = np.where(
            np.abs(velocity) < self._reference, velocity, 0
        )  # a jump of the counter does not change the speed
        measured = np.where(beam, self._reference + doppler, 0)
        if self._board.phase_steps == 256:
            phase = np.where(beam, phase, _NO_MEASUREMENT_BEAM)
        sequence = self._sequence + np.arange(len(count))
        code, data = self._multiplexed(sequence)
        if self._board.sequence_wrap:
            half = self._board.sequence_wrap // 2
            sequence = (sequence + half) % self._board.sequence_wrap - half
        reference = np.full_like(count, self._reference)
        columns = np.stack(
            [reference, measured, count, velocity, phase, sequence, code, data], axis=1
        )
        self._sequence += len(count)
        self._last_count = int(count[-1]) if len(count) else self._last_count
        return (self._line * len(count) % tuple(columns.ravel().tolist())).encode("ascii")

    def _count_and_phase(self, counts: Array) -> tuple[Integers, Integers]:
        """Return the displacement and the phase field of a reading: an 8-bit phase is 0..255, a
        16-bit phase signed."""
        steps = self._board.phase_steps
        if not steps:
            whole = np.floor(counts).astype(np.int64)
            return whole, np.zeros_like(whole)
        fine = np.round(counts * steps).astype(np.int64)
        shift = steps // 2 if steps == 65536 else steps - 1
        whole = (fine + shift) // steps
        return whole, whole * steps - fine

    def _multiplexed(self, sequence: Integers) -> tuple[Integers, Integers]:
        code, data = np.zeros_like(sequence), np.zeros_like(sequence)
        place = sequence % self._board.code_period
        for slot, (number, value) in self._codes.items():
            code[place == slot], data[place == slot] = number, value
        return code, data


class AsciiLine(Counting):
    """Lines made from a format text with the fields ``position_mm``, ``counter`` and ``beam`` (0 or
    1)."""

    def __init__(
        self,
        *,
        rate_hz: float,
        text: str = "{position_mm:+.6f} {counter:05d} {beam:.2f}\r\n",
        counter_modulus: int = 65536,
    ) -> None:
        super().__init__()
        self.rate_hz = rate_hz
        self._text = text
        self._modulus = counter_modulus

    def encode(self, reading_mm: Array, beam: Flags) -> bytes:
        lines = []
        for position_mm, present in zip(reading_mm.tolist(), beam.tolist(), strict=True):
            counter = self._counter % self._modulus
            lines.append(
                self._text.format(
                    position_mm=position_mm, counter=counter, beam=float(present)
                )
            )
            self._counter += 1
        return "".join(lines).encode("ascii")


_STX, _ACK, _NAK, _ESC = b"\x02", b"\x06", b"\x15", b"\x1b"


class NdDisplay:
    """A Heidenhain ND display: it answers STX, ESC A0000, A0100, A0200 and key presses; any other
    request gets NAK."""

    def __init__(self, *, resolution_mm: float = 0.0001) -> None:
        self._resolution_mm = resolution_mm
        self._decimals = max(0, round(-np.log10(resolution_mm)))
        self._pending = b""

    def requests(self, received: bytes) -> list[bytes]:
        """Return the complete requests in the received bytes, and keep the rest."""
        self._pending += received
        complete: list[bytes] = []
        while self._pending:
            if self._pending[:1] != _ESC:
                complete.append(self._pending[:1])
                self._pending = self._pending[1:]
            elif b"\r" in self._pending:
                request, _, self._pending = self._pending.partition(b"\r")
                complete.append(request + b"\r")
            else:
                break
        return complete

    def answer(self, request: bytes, reading_mm: float, *, beam: bool) -> bytes:
        """Return the answer to a request; a display without a signal sends no value."""
        lsb = round(reading_mm / self._resolution_mm)
        if request == b"\x1bA0000\r":
            return _STX + b"ND-287\r\nVIRTUAL\r\n001\r\n"
        if request.startswith((b"\x1bT", b"\x1bF", b"\x1bS")):
            return _ACK
        if request == b"\x1bA0200\r" and beam:
            return _STX + b"%+010d\r\n" % lsb
        if request in (_STX, b"\x1bA0100\r") and beam:
            return _STX + f"{lsb * self._resolution_mm:+.{self._decimals}f}\r\n".encode(
                "ascii"
            )
        return _NAK
