"""Every sample of the laser, the head or the sensor of air in a log, decoded again from the raw
bytes, with its time, in columns.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.files import read_text
from stepdiag.base.messages import message
from stepdiag.daq.log.contents import Log
from stepdiag.daq.log.reader import stored_bytes
from stepdiag.daq.records.events import Chunk, LinkEvent, Loss, Stream
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.timing.stream import NOT_RECORDED, StreamBuffer

AT_ONCE_NS = 30_000_000_000
"""Duration in ns of a block of samples: long enough for the sample clock, short enough for the
memory.
"""
MOST_LINES, MOST_LINES_PER_BYTE = 250_000, 8
"""Largest number of lines in a stream of a log: a constant, plus a number per byte of the log. A
recorder that receives 100 equal lines at a time packs 7 lines into a byte; a crafted log of 46 kB
unpacks to 1.2 million lines.
"""
COLUMNS = ("time_ns", "mono_ns", "counter", "position_mm", "beam", "flags")


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoded:
    """Samples in the order of arrival; every column has shape (count,), ``channels`` (count, k) for
    a 4-DOF head or a sensor.

    ``time_ns`` is in nanoseconds since 1970, ``mono_ns`` in nanoseconds of the host's clock. These
    times come from the sample clock and are not the arrival times.
    """

    time_ns: NDArray[np.int64]
    mono_ns: NDArray[np.int64]
    counter: NDArray[np.int64]
    position_mm: NDArray[np.float64]
    beam: NDArray[np.float64]
    flags: NDArray[np.uint16]
    channels: NDArray[np.float64] | None

    def columns(
        self,
    ) -> dict[str, NDArray[np.int64] | NDArray[np.float64] | NDArray[np.uint16]]:
        found = {name: getattr(self, name) for name in COLUMNS}
        if self.channels is not None:
            found |= {
                f"channel_{number}": column
                for number, column in enumerate(self.channels.T, start=1)
            }
        return found


def decoded(
    log: Log, stream: Stream = "laser", survey_file: Path | None = None
) -> Iterator[Decoded]:
    """Yield the samples of a stream of a log in blocks. ``survey_file`` replaces an unusable survey
    file of the log.

    Raises UsageError for a stream that the survey does not have, DataError for a log without a
    sample of the stream, or with more lines than its bytes can contain.
    """
    text, source = log.header.survey_text, f"{log.path.name}: survey.toml"
    survey = (
        parse_survey(text, source)
        if survey_file is None
        else parse_survey(read_text(survey_file), survey_file.name)
    )
    made = decoders(survey)
    if stream not in made:
        raise UsageError(
            "--stream", expected=message("streams-of-survey", names=list(made)), found=stream
        )
    buffer, begun_ns, any_yet, lines = StreamBuffer(made[stream]), None, False, 0
    most = MOST_LINES + MOST_LINES_PER_BYTE * stored_bytes(log.path)
    for event in log.events():
        match event:
            case Chunk() if event.stream == stream:
                lines += max(event.data.count(end) for end in b"\r\n")
                if lines > most:
                    raise DataError(
                        log.path.name,
                        expected=message("lines-most", count=most),
                        found=str(lines),
                    )
                buffer.feed(event.data, event.arrival_ns)
                begun_ns = begun_ns or event.arrival_ns
                if event.arrival_ns - begun_ns >= AT_ONCE_NS:
                    begun_ns = event.arrival_ns
                    yield from (found := _blocks(buffer, log))
                    any_yet = any_yet or bool(found)
            case LinkEvent() if event.link == stream and event.interrupts:
                buffer.interrupted(event.time_ns)
            case Loss():
                buffer.interrupted(event.time_ns, NOT_RECORDED)
            case _:
                pass
    yield from (found := _blocks(buffer, log))
    if not (any_yet or found):
        raise DataError(
            log.path.name,
            expected=message("samples-of", stream=stream),
            found=message("none"),
            remedy=message("streams-are", names=get_args(Stream)),
        )


def _blocks(buffer: StreamBuffer, log: Log) -> list[Decoded]:
    drained = buffer.drained()
    if not drained:
        return []
    mono = np.round(np.concatenate([times for times, _ in drained])).astype(np.int64)
    batches = [batch for _, batch in drained]
    channels = [batch.channels for batch in batches if batch.channels is not None]
    return [
        Decoded(
            time_ns=mono + log.header.wall_offset_ns,
            mono_ns=mono,
            counter=np.concatenate([batch.counter for batch in batches]),
            position_mm=np.concatenate([batch.position_mm for batch in batches]),
            beam=np.concatenate([batch.beam for batch in batches]),
            flags=np.concatenate([batch.flags for batch in batches]),
            channels=np.concatenate(channels) if channels else None,
        )
    ]
