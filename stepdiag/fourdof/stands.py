"""The standstills in the logs of a commissioning run, with the samples of the head."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.formats.signals import SignalDecoder
from stepdiag.daq.log.contents import Log, open_log
from stepdiag.daq.log.decoded import decoded
from stepdiag.daq.records.events import ModbusBlock
from stepdiag.daq.replay import Replayed
from stepdiag.daq.survey.models import HeadRun, Survey
from stepdiag.fourdof.commission import Standing
from stepdiag.fourdof.record import require_channels

SETTLE_S, SHORTEST_S = 0.3, 1.0
"""Time in s that is omitted after the arrival at a standstill, and the shortest duration of a
standstill after it; the program stands for two seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CommissioningRun:
    """A run of the head along one axis (x, y, z): the mounting of the head, and the standstills in
    the order of time."""

    axis: str
    run: HeadRun
    standings: list[Standing]


def commissioning_run(replayed: Replayed) -> CommissioningRun:
    """Return the standstills of the axis in the head's run: at the stops, and at the jogs beside
    them. Raises DataError without such a run, or for runs of several axes."""
    section = replayed.survey.head
    outcomes = [
        (log, one)
        for log in replayed.logs
        for one in log.outcomes
        if isinstance(one, CapturedStop)
    ]
    axes = {one.setup[-1] for _, one in outcomes if one.setup.startswith("fourdof-")}
    if section is None or len(axes) != 1:
        found = ", ".join(sorted(axes)) or message("none")
        raise DataError(
            str(replayed.logs[0].path), expected=message("head-run-of-one-axis"), found=found
        )
    axis = axes.pop()
    paths = dict.fromkeys(log.path for log, one in outcomes if one.setup == f"fourdof-{axis}")
    standings = [one for path in paths for one in _standings(open_log(path), replayed.survey)]
    return CommissioningRun(axis=axis, run=section.run_along(axis), standings=standings)


def _standings(log: Log, survey: Survey) -> Iterator[Standing]:
    blocks = list(decoded(log, "head"))
    time_ns = np.concatenate([block.mono_ns for block in blocks])
    channels = np.concatenate(
        [require_channels(block.channels, log.path.name) for block in blocks]
    )
    finite = np.isfinite(channels).all(axis=1)
    time_ns, channels = time_ns[finite], channels[finite]
    for position, from_ns, to_ns in _still(log, survey):
        here = (time_ns >= from_ns) & (time_ns <= to_ns)
        if here.any():
            yield Standing(
                position_mm=position,
                time_s=1e-9 * (time_ns[here] - time_ns[0]),
                channels=channels[here],
            )


def _still(log: Log, survey: Survey) -> Iterator[tuple[Vector, float, float]]:
    try:
        signals = SignalDecoder(survey.plc.signals, survey.plc.parsed())
    except UsageError as error:
        raise DataError(log.path.name, expected=error.message, found="") from error
    begun: tuple[tuple[float, float, float], int] | None = None
    last_ns = 0
    for event in log.events():
        if not isinstance(event, ModbusBlock):
            continue
        signals_now = signals.decode(event)
        if signals_now.commanded_mm is None:
            expected = message("commanded-positions")
            raise DataError(
                log.path.name,
                expected=expected,
                found=message("none"),
                remedy=message("map-x-y-z"),
            )
        here = None if signals_now.stopped else signals_now.commanded_mm
        if begun is not None and here != begun[0]:
            yield from _long_enough(begun, last_ns)
            begun = None
        if here is not None:
            begun = begun or (here, event.recv_ns)
        last_ns = event.send_ns
    if begun is not None:
        yield from _long_enough(begun, last_ns)


def _long_enough(
    begun: tuple[Sequence[float], int], last_ns: int
) -> Iterator[tuple[Vector, float, float]]:
    place, from_ns = begun
    settled_ns = from_ns + 1e9 * SETTLE_S
    if last_ns - settled_ns >= 1e9 * SHORTEST_S:
        yield np.array(place, dtype=np.float64), settled_ns, float(last_ns)
