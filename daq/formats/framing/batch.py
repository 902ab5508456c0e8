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
"""Columns of samples: counter, position in mm, beam and flags, each of shape (rows,)."""


class Batch:
    """A growing batch of samples; a notice belongs to the sample that is added after the notice."""

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
        """Append samples, one row each; a missing beam is unknown (NaN). Either every added part
        has channels, or no part.
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
        """Add a remark before the next sample, or before the sample at ``index``. The other
        arguments are those of `Notice`.
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
        """Append the faults of the counter in the rows that are added next; ``keep`` (rows,) is
        False for rows that are left out.
        """
        for found in breaks:
            index = self.count + int(keep[: found.row].sum())
            self.note(found.code, found.why, value=found.missing, index=index)

    def doubt(self, flag: Flag) -> None:
        """Set ``flag`` in every sample added so far."""
        for _, _, _, flags in self._parts:
            np.bitwise_or(flags, np.uint16(flag), out=flags)

    def samples(self, arrival_ns: int | NDArray[np.int64]) -> Samples:
        """Return all added samples, stamped with ``arrival_ns``: a single time, or one time per
        row.
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
    """Set ``flag`` in the rows in which ``where`` is True."""
    flags[where] |= np.uint16(flag)


def judge_beam(
    beam: NDArray[np.float64], threshold: float, flags: NDArray[np.uint16]
) -> None:
    """Flag a beam (0 to 1) below ``threshold`` as lost, and a beam below twice the threshold as
    weak; an unknown beam (NaN) gets no flag.
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
"""The empty batch of samples: the result for a chunk that completes no sample."""
