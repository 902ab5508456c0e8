"""A log of a survey as numpy arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.replay import replay
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.formats import laser_decoder
from stepdiag.daq.timing.samples import Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedLog:
    """A log as numpy arrays. ``laser`` contains every sample as columns, ``stops`` the captured
    stops in order."""

    laser: Samples
    stops: tuple[CapturedStop, ...]


def read_log(path: Path | str) -> RecordedLog:
    """Return the stops of a log and every sample of its laser, decoded again from the raw bytes.

    Raises ``DataError`` for a file that is not a log of this program.
    """
    log = open_log(Path(path))
    decoder = laser_decoder(
        parse_survey(log.header.survey_text, f"{Path(path).name}: survey.toml")
    )
    batches = [decoder.feed(b"", 0)]
    for event in log.events():
        match event:
            case Chunk(stream="laser"):
                batches.append(decoder.feed(event.data, event.arrival_ns))
            case LinkEvent(link="laser") if event.interrupts:
                decoder.resync()
            case _:
                pass
    outcomes = (each for one in replay([Path(path)]).logs for each in one.outcomes)
    return RecordedLog(
        laser=_one_batch(batches),
        stops=tuple(each for each in outcomes if isinstance(each, CapturedStop)),
    )


def _one_batch(batches: Sequence[Samples]) -> Samples:
    return Samples(
        counter=np.concatenate([batch.counter for batch in batches]),
        position_mm=np.concatenate([batch.position_mm for batch in batches]),
        beam=np.concatenate([batch.beam for batch in batches]),
        flags=np.concatenate([batch.flags for batch in batches]),
        arrival_ns=np.concatenate([batch.arrival_ns for batch in batches]),
    )
