"""State of a survey at the beginning of a log. The log holds this state, so that a replay begins in
the same way.
"""

from collections.abc import Mapping

import msgspec

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import CapturedStop, from_log
from stepdiag.daq.capture.conditions import Credible
from stepdiag.daq.records.events import Link
from stepdiag.daq.timing.stream import Break


class PassHint(msgspec.Struct, frozen=True, kw_only=True):
    """State of a setup at the beginning of a log: direction and number of the next stop, and the
    last reading.

    ``known`` are the readings on the present unbroken count of the laser, by stop of the outward
    route. ``turn`` is the last stop of the previous pass in the other direction: a program that
    reverses there begins the return pass with this stop. ``believed`` are the readings of stops
    that were assumed to be the last stops of a pass. If the machine's next step continues these
    stops, they were the first stops of a pass. ``numbers`` are the numbers of the next outward and
    the next return pass, whose order of axes may differ. ``others`` are the numbers of passes with
    other orders of the axes, which the machine may drive instead.
    """

    outward: bool = True
    numbers: tuple[int, int] = (1, 2)
    others: tuple[int, ...] = ()
    next_stop: int = 0
    last_reading_mm: float | None = None
    known: dict[int, float] = {}
    turn: CapturedStop | None = None
    believed: tuple[float, ...] = ()
    wanted: bool = True


class CaptureStart(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a survey at the beginning of a log, for the capture of this log: the wanted
    setups in order, and the stop that is captured already.

    ``wall_offset_ns`` is the time of day minus the host's clock at the beginning of the recording.
    All stops use this offset, so that a change of the time of day does not change the time between
    stops. ``breaks`` are the losses of count since the last stop of the previous log, ``credible``
    the last credible values of air and material. ``beyond`` is true if the machine overran its last
    stop in the previous log, None if this is unknown or the log is of an older version. ``down``
    are the links that are down. ``named`` are the wrong lines of the survey file that findings of
    earlier logs name.
    """

    hints: dict[str, PassHint]
    wall_offset_ns: int = 0
    last_count: int | None = None
    skip_open_dwell: bool = False
    breaks: tuple[Break, ...] = ()
    credible: dict[str, Credible] = {}
    beyond: bool | None = None
    down: tuple[Link, ...] = ()
    named: tuple[str, ...] = ()


def start_of(run: Mapping[str, str], source: str) -> CaptureStart:
    """Return the state from a log's ``stepdiag.run`` record. Raises DataError if the state is
    missing or damaged.
    """
    try:
        start = msgspec.json.decode(run["start"])
        for hint in start["hints"].values():
            if hint.get("turn"):
                hint["turn"] = from_log(hint["turn"])
        return msgspec.convert(start, CaptureStart, str_keys=True)
    except (
        KeyError,
        TypeError,
        AttributeError,
        msgspec.DecodeError,
        RecursionError,
    ) as error:
        raise DataError(source, expected=message("start-record"), found=str(error)) from error
