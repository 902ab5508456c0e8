"""The sample counter of an instrument through wraps, gaps, duplicates and restarts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message

LONGEST_WRAP_GAP = 1000
"""Largest number of missing samples across the wrap of a counter; a larger number is a restart of
the instrument.
"""
LONGEST_GAP = 10_000_000
"""Largest gap in samples (hours at any known rate). A larger forward step of the counter is a
restart of the count.
"""


@dataclass(frozen=True, slots=True)
class Wrap:
    """The range of a counter that counts from ``low`` to ``high`` and then starts again at ``low``.
    Across the wrap at most ``reach`` steps are accepted.
    """

    low: int
    high: int
    reach: int

    def across(self, previous: int, current: int) -> int | None:
        """Return the number of steps from ``previous`` to the smaller ``current`` across the wrap;
        None for more than ``reach`` steps.
        """
        if previous > self.high or current < self.low:
            return None
        steps = current - previous + self.high - self.low + 1
        return steps if 0 < steps <= self.reach else None


@dataclass(frozen=True, slots=True)
class Break:
    """An irregular step of the counter before row ``row``; ``missing`` is the number of samples
    lost in a gap.
    """

    code: Literal["gap", "duplicate", "restart"]
    row: int
    why: Message
    missing: int | None = None


@dataclass(frozen=True, slots=True)
class Unwrapped:
    """The result of `CounterTrack.follow`. ``counter``, shape (rows kept,), increases strictly.
    ``keep``, shape (rows,), is False for duplicates. Consecutive duplicates are one entry of
    ``breaks``.
    """

    counter: NDArray[np.int64]
    keep: NDArray[np.bool_]
    breaks: tuple[Break, ...]


class CounterTrack:
    """Unwraps the counter of one stream.

    After a restart of the instrument the unwrapped counter continues with the next number. The
    length of the interruption is unknown, so the caller must start a new clock.
    """

    def __init__(self, wraps: Sequence[Wrap]) -> None:
        self._wraps = tuple(wraps)
        self._raw: int | None = None
        self._count: int | None = None
        self._repeating = False

    def forget(self) -> None:
        """Accept any next value of the counter as one step after the last sample."""
        self._raw = None

    def goes_on(self, raw: NDArray[np.int64]) -> bool:
        """Return whether the counters ``raw``, shape (rows,), continue from the last row in steps
        of one. The state of the track does not change.
        """
        return (
            self._raw is not None
            and not self._repeating
            and int(raw[0]) == self._raw + 1
            and bool((raw[1:] - raw[:-1] == 1).all())
        )

    def follow(self, raw: NDArray[np.int64], *, restarted: bool = False) -> Unwrapped:
        """Return the unwrapped counter of the rows ``raw``, shape (rows,), at least one row.

        ``restarted`` means that the instrument sent its greeting before the first row. The counter
        then began again, unless the first row continues the count.
        """
        if self._count is None:
            self._count = int(raw[0]) - 1
        previous = int(raw[0]) - 1 if self._raw is None else self._raw
        steps = np.empty(len(raw), dtype=np.int64)
        steps[0] = raw[0] - previous
        np.subtract(raw[1:], raw[:-1], out=steps[1:])
        breaks: list[Break] = []
        if restarted and self._raw is not None and (steps[0] != 1 or raw[0] == 0):
            breaks.append(_restart(0, previous, int(raw[0])))
            steps[0] = 1
        for row in np.flatnonzero(steps != 1).tolist():
            repeating = self._repeating if row == 0 else steps[row - 1] == 0
            steps[row], remark = self._judge(
                row, int(raw[row - 1]) if row else previous, int(raw[row])
            )
            if remark and not (repeating and remark.code == "duplicate"):
                breaks.append(remark)
        self._repeating = bool(steps[-1] == 0)
        counter = steps.cumsum()
        counter += self._count
        self._raw, self._count = int(raw[-1]), int(counter[-1])
        keep = steps != 0
        return Unwrapped(counter[keep], keep, tuple(breaks))

    def _judge(self, row: int, previous: int, current: int) -> tuple[int, Break | None]:
        if current == previous:
            return 0, Break("duplicate", row, message("count-again", count=current))
        step: int | None = current - previous
        if current < previous:
            over_the_end = (wrap.across(previous, current) for wrap in self._wraps)
            step = next((steps for steps in over_the_end if steps is not None), None)
        if step is None or step > LONGEST_GAP:
            return 1, _restart(row, previous, current)
        missing = step - 1
        if missing:
            return step, Break(
                "gap",
                row,
                message("samples-between", count=missing, a=previous, b=current),
                missing,
            )
        return step, None


def _restart(row: int, previous: int, current: int) -> Break:
    return Break("restart", row, message("began-anew", a=previous, b=current))
