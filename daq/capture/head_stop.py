"""A stop of a 4-DOF run: the time window of the stop is found in the stream of the head, because
there may be no laser that measures along the axis of the run.

The head is steady when its quadrant detector is steady. A slide that coasts to rest appears in the
head's stream as vibration, not as travel; only Modbus reports that the machine stands.
"""

import math
from typing import Literal

import numpy as np

from stepdiag.base.messages import Message, message
from stepdiag.daq.capture.standing.dwell import Dwell
from stepdiag.daq.timing.samples import Flag
from stepdiag.daq.timing.stream import Break, Span, StreamBuffer

NOMINAL_QD_MM = 0.6
"""Movement of the target in mm for one unit of the normalised QD reading, by the slope at the
centre of the detector, for a spot of 2 mm radius (0.3 to 0.9 mm for 1 to 3 mm). This figure only
judges whether the signal is steady; the measurement uses the head's calibration.
"""
LEVER_MM = 100.0
"""Lever in mm that converts an angle to a movement, to judge whether the instrument has come to
rest.
"""
Trouble = Literal[
    "fourdof-beam-blocked.in-dwell",
    "fourdof-out-of-range.detector",
    "fourdof-out-of-range",
    "instrument-reports.head",
]
TROUBLES: tuple[tuple[Flag, Trouble], ...] = (
    (Flag.BEAM_LOST, "fourdof-beam-blocked.in-dwell"),
    (Flag.SATURATED, "fourdof-out-of-range.detector"),
    (Flag.OUT_OF_RANGE, "fourdof-out-of-range"),
    (Flag.DEVICE_ERROR, "instrument-reports.head"),
)


class QdView:
    """The head's stream as a length: ``position_mm`` is the lateral movement of the target on the
    QD, in x or y, whichever moves more.
    """

    def __init__(self, head: StreamBuffer) -> None:
        self._head = head

    resolution_um = math.inf
    """Unknown, because the quotient of two signals has no smallest step."""

    @property
    def breaks(self) -> list[Break]:
        """Return the losses of light. The samples of a dwell before a loss are not used."""
        return self._head.breaks

    def newest_ns(self) -> float:
        return self._head.newest_ns()

    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf) -> Span:
        """Return the usable samples of a span of time; samples without light on the QD count as
        unusable.
        """
        span = self._head.span(from_ns, to_ns, arrived_before_ns)
        if span.channels is None or not len(span.channels):
            return span
        total = span.channels[:, 2]
        lit = total > 0
        lateral = NOMINAL_QD_MM * span.channels[lit][:, :2] / total[lit, None]
        livelier = int(np.argmax(np.std(lateral, axis=0))) if len(lateral) else 0
        return Span(
            time_ns=span.time_ns[lit],
            position_mm=lateral[:, livelier],
            beam=span.beam[lit],
            channels=span.channels[lit],
            unusable=span.unusable + int(np.count_nonzero(~lit)),
        )


class AngleView(QdView):
    """The stream of an autocollimator or a level as a length: ``position_mm`` is the angle with the
    larger scatter, times the lever `LEVER_MM`.
    """

    def span(self, from_ns: float, to_ns: float, arrived_before_ns: float = math.inf) -> Span:
        span = self._head.span(from_ns, to_ns, arrived_before_ns)
        if span.channels is None or not len(span.channels):
            return span
        turned = span.channels * 1e-6 * LEVER_MM
        return Span(
            time_ns=span.time_ns,
            position_mm=turned[:, int(np.argmax(np.std(turned, axis=0)))],
            beam=span.beam,
            channels=span.channels,
            unusable=span.unusable,
        )


def troubles(head: StreamBuffer, dwell: Dwell) -> list[Message]:
    """Return the faults of the head's samples in a dwell."""
    flags = head.flags(dwell.from_ns, dwell.to_ns)
    found = []
    for flag, key in TROUBLES:
        count = int(np.count_nonzero(flags & int(flag)))
        if count:
            found.append(message(key, wrong=count, count=len(flags)))
    return found
