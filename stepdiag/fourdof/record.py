"""Samples of a 4-DOF head for commissioning: from the port of the head, from a log, or from a
CSV."""

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepdiag.base.csv_table import number_in, read_table
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.volume import Vector
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.records.events import Chunk
from stepdiag.daq.survey.file import head_decoder, parse_survey
from stepdiag.daq.survey.models import Survey
from stepdiag.daq.timing.samples import Decoder, Samples
from stepdiag.daq.timing.stream import UNUSABLE
from stepdiag.fourdof.runs import CHANNELS, QD_ONLY

COLUMNS = tuple(
    f"{detector}_{part}" for detector in ("qd", "psd1", "psd2") for part in ("x", "y", "sum")
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadRecord:
    """Usable samples in the order of time: ``time_s`` (N,) is the time since the first sample;
    ``channels`` has the shape (N, 9), or (N, 3) for a head with a QD only.

    ``unusable`` is the number of omitted samples (blocked, saturated, faulty).
    """

    time_s: Vector
    channels: Vector
    unusable: int = 0

    def averaged(self, interval_s: float) -> "HeadRecord":
        """Return the means of the samples over equal intervals; an incomplete last interval is left
        out. Raises DataError for an interval without samples."""
        intervals = (self.time_s - self.time_s[0]) / interval_s + 1e-9
        # with more intervals than samples some are empty; without this limit a wrong clock could
        # request any number of intervals
        place = np.floor(np.minimum(intervals, len(intervals))).astype(np.int64)
        count = np.bincount(place)[: max(int(place[-1]), 1)]
        if not count.all():
            at = float(np.argmin(count)) * interval_s
            raise DataError(
                "4-DOF head",
                expected=message("samples-every-s", interval_s=interval_s),
                found=message("none-from-s-on", at=at),
                remedy=message("keep-beam-free"),
            )
        sums = [
            np.bincount(place, weights=column)[: len(count)] for column in self.channels.T
        ]
        middle = np.asarray(interval_s * (np.arange(len(count)) + 0.5), dtype=np.float64)
        return HeadRecord(time_s=middle, channels=np.column_stack(sums) / count[:, None])


class _Gathering:
    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._batches: list[Samples] = []

    def feed(self, data: bytes, arrival_ns: int) -> Samples:
        batch = self._decoder.feed(data, arrival_ns)
        if len(batch):
            self._batches.append(batch)
        return batch

    def record(self, source: str) -> HeadRecord:
        flags = np.concatenate(
            [np.zeros(0, dtype=np.uint16), *(batch.flags for batch in self._batches)]
        )
        good = (flags & int(UNUSABLE)) == 0
        if not good.any():
            found = (
                message("samples-all-blocked-saturated", flags=len(flags))
                if len(flags)
                else message("nothing-understands")
            )
            raise DataError(
                source,
                expected=message("samples-head"),
                found=found,
                remedy=message("stepdiag-fourdof-align-shows"),
            )
        time = np.concatenate([batch.arrival_ns for batch in self._batches])[good] * 1e-9
        channels = np.concatenate(
            [batch.channels for batch in self._batches if batch.channels is not None]
        )[good]
        return HeadRecord(
            time_s=time - time[0], channels=channels, unusable=int(np.count_nonzero(~good))
        )


def read_head_csv(text: str, source: str) -> HeadRecord:
    """Return the samples of a CSV: ``time_s``, ``qd_x``, ``qd_y``, ``qd_sum``, and the same columns
    of psd1 and psd2, which a head with a QD only does not have.

    Raises DataError with the line for any other content, and for times that do not ascend.
    """
    table = read_table(text, source, ("time_s", *COLUMNS[:QD_ONLY]))
    names = COLUMNS if "psd1_x" in table[0][1] else COLUMNS[:QD_ONLY]
    rows = [
        [number_in(fields, name, f"{source}: line {line}") for name in ("time_s", *names)]
        for line, fields in table
    ]
    values = np.array(rows)
    back = np.flatnonzero(np.diff(values[:, 0]) < 0)
    if len(back):
        raise DataError(
            f"{source}: line {table[int(back[0]) + 1][0]}",
            expected=message("time-after-one-before"),
            found=message("earlier-one"),
        )
    return HeadRecord(time_s=values[:, 0] - values[0, 0], channels=values[:, 1:])


def render_head_csv(record: HeadRecord) -> str:
    names = COLUMNS[: record.channels.shape[1]]
    lines = [
        f"{time:.6f}," + ",".join(f"{value:.10g}" for value in row)
        for time, row in zip(record.time_s, record.channels, strict=True)
    ]
    return "\n".join([",".join(("time_s", *names)), *lines]) + "\n"


def head_of_log(path: Path) -> HeadRecord:
    """Return the samples of the head in a log. Raises DataError for a log without a head."""
    log = open_log(path)
    survey = parse_survey(log.header.survey_text, f"{path.name}: survey.toml")
    if survey.head is None:
        raise DataError(
            str(path),
            expected=message("log-survey-with-head"),
            found=message("survey-without-one"),
        )
    gathering = _Gathering(head_decoder(survey))
    for event in log.events():
        if isinstance(event, Chunk) and event.stream == "head":
            gathering.feed(event.data, event.arrival_ns)
    return gathering.record(str(path))


def listen_to_head(
    survey: Survey,
    source: str,
    seconds: float,
    on_batch: Callable[[Samples], None] | None = None,
) -> HeadRecord:
    """Return the samples of a survey file's head over a number of seconds; ``on_batch`` receives
    every batch during the recording.

    Ctrl-C ends the recording and keeps the samples. Raises UsageError without [head], DeviceError
    for a port that cannot be opened or is lost.
    """
    if survey.head is None:
        raise UsageError(source, expected=message("head-section"), found=message("none"))
    gathering = _Gathering(head_decoder(survey))
    with suppress(KeyboardInterrupt):
        asyncio.run(_listen(survey, gathering, seconds, on_batch))
    return gathering.record(source)


async def _listen(
    survey: Survey,
    gathering: _Gathering,
    seconds: float,
    on_batch: Callable[[Samples], None] | None,
) -> None:
    # imported here, because only the recording from a port needs Linux
    from stepdiag.daq.links.ports.serial import instrument_line
    from stepdiag.daq.recording.survey_links import serial_settings

    section = survey.head
    if section is None:
        return
    loop = asyncio.get_running_loop()

    def take(data: bytes, arrival_ns: int) -> None:
        batch = gathering.feed(data, arrival_ns)
        if on_batch is not None and len(batch):
            on_batch(batch)

    def arrived(data: bytes, arrival_ns: int) -> None:
        loop.call_soon_threadsafe(take, data, arrival_ns)

    stream = instrument_line(serial_settings(section), head_decoder(survey), arrived)
    try:
        await asyncio.wait_for(
            stream.session(lambda *_: None), None if math.isinf(seconds) else seconds
        )
    except TimeoutError:
        return


def require_angles(record: HeadRecord, source: str) -> None:
    """Raise DataError for a head with a QD only, because it measures no pitch, yaw or drift."""
    require_channels(record.channels, source)


def require_channels(channels: Vector | None, source: str) -> Vector:
    """Return the nine channels of a head, shape (N, 9). Raises DataError for a head with a QD
    only."""
    count = 0 if channels is None else int(channels.shape[1])
    if channels is None or count != CHANNELS:
        raise DataError(
            source,
            expected=message("nine-channels-qd-psd1"),
            found=message("qd-alone", shape=str(count)),
        )
    return channels
