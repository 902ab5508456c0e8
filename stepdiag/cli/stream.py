"""``stepdiag stream``: a recording of another program as the log of one setup."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import typer

from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words

LARGEST_SERIES_BYTES = 400_000_000
"""Largest number of laser positions in a recording: fifty million, a quarter of an hour at 50
kHz."""


def register(app: typer.Typer) -> None:
    app.command("stream")(stream)


def stream(
    survey: Path,
    setup: str,
    series: Path,
    unit: Annotated[Literal["m", "mm", "um", "nm"], typer.Option()],
    began: datetime | None = None,
) -> None:
    """Store a recorded time series as the log of one setup."""
    from stepdiag.base.files import as_text, read_bytes, read_text
    from stepdiag.daq.recording.rounds import FolderLock, latest_round
    from stepdiag.daq.recording.series import parse_csv_series, parse_rtx
    from stepdiag.daq.recording.streamed import record_series, require_such_lines
    from stepdiag.daq.survey.bundle import run_record
    from stepdiag.daq.survey.file import load_survey

    known = load_survey(survey)
    rate_hz = require_such_lines(known, survey.name)
    if series.suffix.lower() == ".rtx":
        whole = parse_rtx(read_bytes(series, largest=LARGEST_SERIES_BYTES), unit, series.name)
    else:
        whole = parse_csv_series(
            as_text(read_bytes(series, largest=LARGEST_SERIES_BYTES), series.name),
            unit,
            series.name,
        )
    seconds = len(whole.position_mm) / whole.rate_hz
    at_s = (
        series.stat().st_mtime - seconds
        if began is None
        else began.replace(tzinfo=began.tzinfo or UTC).timestamp()
    )
    folder = known.folder(survey)
    lock = FolderLock.take(folder)
    try:
        text = read_text(survey)
        begun = latest_round(folder, text, run_record(known, survey))
        stops = record_series(known, text, begun, setup, whole.at_rate(rate_hz), at_s=at_s)
    finally:
        lock.release()
    print_words(
        message(
            "stream-taken",
            setup=setup,
            stops=len(stops),
            seconds=seconds,
            rate_hz=whole.rate_hz,
            path=str(survey),
        )
    )
