"""A setup that another program recorded: the session processes its series of positions like a live
laser.

The samples become text lines in the form of the survey's ``[laser.line]``, with arrival times from
the numbers of the samples. So a series is logged, replayed, doubted and solved in the same way as a
laser that this program recorded. The stops are identified as for a machine without signals
(`daq.capture.by_laser`).
"""

from collections.abc import Iterator

import numpy as np

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.recording.series import Series
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import DirectSink
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.survey.bundle import compensation_findings
from stepdiag.daq.survey.formats import laser_decoder
from stepdiag.daq.survey.models import Survey

SECOND_NS = 1_000_000_000
CHUNK_S = 0.05
"""Duration in s of a chunk, similar to that of a serial line."""
LINE = "{count} {position:.9f}\n"
SECTION = """[laser]
format = "line"
[laser.line]
pattern = '(?P<counter>[0-9]+) (?P<position>-?[0-9.]+)'
counter_modulus = 1000000000"""
"""The part of a survey file that describes the text lines, without ``port``, ``compensated`` and
``rate_hz``.
"""


def require_such_lines(survey: Survey, source: str) -> float:
    """Return the sample rate of the survey's laser in Hz. Raises UsageError if the survey file
    describes other lines.
    """
    remedy = message("stream-survey-remedy", section=SECTION)
    if not survey.plc.silent:
        raise UsageError(
            f"{source}: plc.transport",
            expected='"none"',
            found=repr(survey.plc.transport),
            remedy=remedy,
        )
    line = survey.laser.line
    if survey.laser.format != "line" or line is None or line.rate_hz is None:
        raise UsageError(
            f"{source}: laser.format",
            expected=message("stream-lines"),
            found=repr(survey.laser.format),
            remedy=remedy,
        )
    taken = laser_decoder(survey).feed(b"".join(_series_lines(np.array([0.0, 1.25]), 0)), 1)
    if not np.array_equal(taken.position_mm * survey.laser.sign, [0.0, 1.25]):
        raise UsageError(
            f"{source}: laser.line.pattern",
            expected=message("stream-lines"),
            found=repr(line.pattern),
            remedy=remedy,
        )
    return line.rate_hz


def record_series(
    survey: Survey, text: str, begun: Round, setup: str, series: Series, *, at_s: float
) -> tuple[CapturedStop, ...]:
    """Record a setup from a series that began at ``at_s`` (seconds since 1970). Return its stops,
    pass after pass.

    Raises UsageError if the survey has no open pass of the setup, DataError if the series lacks a
    stop of a pass; the logs then remain, like the logs of an unsuccessful pass.
    """
    taken: list[CapturedStop] = []
    session = Session(
        survey,
        text,
        begun,
        DirectSink(),
        on_outcome=lambda outcome: (
            taken.append(outcome) if isinstance(outcome, CapturedStop) else None
        ),
        wall_offset_ns=lambda: round(at_s * SECOND_NS),
    )
    for finding in compensation_findings(survey):
        session.found(finding)
    session.consume(LinkEvent(0, "laser", "connected", ""))
    session.begin(setup, 0)
    for event in _chunks(series):
        session.consume(event)
    session.close(message("stream-ended"))
    wanted = len(session.book.open_passes(setup))
    if wanted:
        raise DataError(
            setup,
            expected=message("stream-every-pass"),
            found=message("stream-passes-open", passes=wanted, stops=len(taken)),
            remedy=message("stream-dwell-remedy", dwell_s=survey.plan.dwell_s),
        )
    return tuple(taken)


def _chunks(series: Series) -> Iterator[Chunk]:
    size = max(1, round(CHUNK_S * series.rate_hz))
    for first in range(0, len(series.position_mm), size):
        part = series.position_mm[first : first + size]
        yield Chunk(
            "laser",
            round((first + len(part)) / series.rate_hz * SECOND_NS),
            b"".join(_series_lines(part, first)),
        )


def _series_lines(
    positions_mm: "np.ndarray[tuple[int], np.dtype[np.float64]]", first: int
) -> Iterator[bytes]:
    return (
        LINE.format(count=count, position=position).encode()
        for count, position in enumerate(positions_mm.tolist(), first)
    )
