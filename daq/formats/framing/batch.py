"""Collects the columns of one batch of samples."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Words
from stepdiag.daq.formats.framing.counter import Break
from stepdiag.daq.timing.samples import Flag, Notice, NoticeCode, Samples

Columns = tuple[
    NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.uint16]
]
"""Columns of samples: counter, position in mm, beam strength, and flags, each of shape (rows,)."""


class Batch:
    """A growing batch of samples. A notice belongs to the sample that is added after the notice."""

    def __init__(self) -> None:
        self.count = 0
        self.notices: list[Notice] = []
        self._parts: list[Columns] = []
        self._channels: list[NDArray[np.float64]] = []

    def add(
        self,
        counter: NDArray[np.int64],
        position_mm: NDArray[np.float64],
        flags: NDArray[np.uint16],
        *,
        beam: NDArray[np.float64] | None = None,
        channels: NDArray[np.float64] | None = None,
    ) -> None:
        """Append samples, one per row; a missing beam strength is NaN. Channels are given in every
        call, or in none.
        """
        self._parts.append(
            (counter, position_mm, _unknown(len(counter)) if beam is None else beam, flags)
        )
        if channels is not None:
            self._channels.append(channels)
        self.count += len(counter)

    def note(
        self,
        code: NoticeCode,
        why: Words = "",
        *,
        value: float | None = None,
        name: str = "",
        index: int | None = None,
    ) -> None:
        """Add a notice before the next sample, or before the sample at ``index``. The arguments are
        those of `Notice`.
        """
        self.notices.append(
            Notice(
                code=code,
                index=self.count if index is None else index,
                why=why,
                value=value,
                name=name,
            )
        )

    def remark(self, breaks: Iterable[Break], keep: NDArray[np.bool_]) -> None:
        """Append the faults of the counter in the rows that are added next. ``keep``, shape
        (rows,), is False for rows that are left out.
        """
        for found in breaks:
            index = self.count + int(keep[: found.row].sum())
            self.note(found.code, found.why, value=found.missing, index=index)

    def doubt(self, flag: Flag) -> None:
        for _, _, _, flags in self._parts:
            np.bitwise_or(flags, np.uint16(flag), out=flags)

    def samples(self, arrival_ns: int | NDArray[np.int64]) -> Samples:
        """Return all added samples; ``arrival_ns`` is one arrival time for all rows, or one for
        each row.
        """
        if not self._parts and not self.notices:
            return NOTHING
        counter, position_mm, beam, flags = self._joined()
        stamps = np.empty(self.count, dtype=np.int64)
        stamps[:] = arrival_ns
        return Samples(
            counter=counter,
            position_mm=position_mm,
            beam=beam,
            flags=flags,
            arrival_ns=stamps,
            channels=np.concatenate(self._channels) if self._channels else None,
            notices=tuple(self.notices),
        )

    def _joined(self) -> Columns:
        if len(self._parts) == 1:
            return self._parts[0]
        counters, positions, beams, flags = zip(_NO_ROWS, *self._parts, strict=True)
        return (
            np.concatenate(counters),
            np.concatenate(positions),
            np.concatenate(beams),
            np.concatenate(flags),
        )


def mark(flags: NDArray[np.uint16], where: NDArray[np.bool_], flag: Flag) -> None:
    flags[where] |= np.uint16(flag)


def judge_beam(
    beam: NDArray[np.float64], threshold: float, flags: NDArray[np.uint16]
) -> None:
    """Set the flag of a lost beam for a strength below ``threshold``, and the flag of a weak beam
    below twice ``threshold``. An unknown strength (NaN) gets no flag.
    """
    lost = beam < threshold
    mark(flags, lost, Flag.BEAM_LOST)
    mark(flags, (beam < 2 * threshold) & ~lost, Flag.WEAK_BEAM)


def _unknown(rows: int) -> NDArray[np.float64]:
    column = np.empty(rows)
    column.fill(np.nan)
    return column


_NO_ROWS: Columns = (
    np.empty(0, dtype=np.int64),
    np.empty(0),
    np.empty(0),
    np.empty(0, dtype=np.uint16),
)

NOTHING = Samples(
    counter=_NO_ROWS[0],
    position_mm=_NO_ROWS[1],
    beam=_NO_ROWS[2],
    flags=_NO_ROWS[3],
    arrival_ns=_NO_ROWS[0],
)
"""An empty batch: the result for a chunk that completes no sample."""
