"""Sources of data for the commands of the 4-DOF head: live head, log, CSV, input at the stage,
calibration file."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import message
from stepdiag.terminal.viewer import print_words, shown

if TYPE_CHECKING:
    from stepdiag.daq.survey.head_file import AxisName, DetectorName, HeadFile
    from stepdiag.fourdof.commissioning import Curves, StageRun
    from stepdiag.fourdof.record import HeadRecord
    from stepdiag.fourdof.runs import HeadMeasured

STAGE_S = 1.0
"""Averaging time in s of the head at each place of a live calibration."""


def head_of_logs(logs: list[Path]) -> "HeadMeasured":
    """Return the results of the head's passes in logs. Raises DataError without a complete pass."""
    from stepdiag.completion import completion
    from stepdiag.daq.replay import find_logs, replay

    measured = completion.head_of_logs(replay(find_logs(logs)))
    if not measured.straightness:
        raise DataError(
            str(logs[0]),
            expected=message("whole-head-pass"),
            found=message("none"),
            remedy=message("drive-fourdof"),
        )
    return measured


def head_record(
    source: Path, default_s: float, ask: str = "", *, stated_s: float | None = None
) -> "HeadRecord":
    """Return the samples of a source, whose suffix determines its kind. If ``ask`` is a request to
    the person, a live recording begins after Enter.

    A live head is recorded for ``stated_s`` seconds, or ``default_s``. Raises ``UsageError`` for a
    time with a log or a CSV.
    """
    from stepdiag.base.files import read_text
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.fourdof.record import head_of_log, listen_to_head, read_head_csv
    from stepdiag.terminal.progress import working

    suffix, seconds = source.suffix.lower(), stated_s or default_s
    if stated_s is not None and suffix in (".csv", ".mcap"):
        raise UsageError("--seconds", expected=message("a-survey-file"), found=source.name)
    if suffix == ".csv":
        return read_head_csv(read_text(source), source.name)
    if suffix == ".mcap":
        return head_of_log(source)
    if suffix != ".toml":
        raise UsageError(
            str(source),
            expected=message("head-source"),
            found=source.suffix or message("no-suffix"),
        )
    survey = load_survey(source)
    if ask:
        typer.prompt(shown(message("press-enter", what=ask)), default="", show_default=False)
    with working(message("listening-to-head", seconds_s=seconds)):
        return listen_to_head(survey, source.name, seconds)


def read_calibration(path: Path) -> "HeadFile":
    """Return a calibration file. Raises UsageError for an unreadable file or a wrong field."""
    from stepdiag.base.files import LARGEST_SETTINGS_BYTES, read_bytes
    from stepdiag.daq.survey.head_file import parse_head_file

    return parse_head_file(
        read_bytes(path, largest=LARGEST_SETTINGS_BYTES, blame=UsageError), path.name
    )


def write_calibration(path: Path, file: "HeadFile") -> None:
    """Write a new calibration file."""
    from stepdiag.base.files import write_new
    from stepdiag.daq.survey.head_file import render_head_file

    write_new(path, render_head_file(file))


def stage_run(source: Path, detector: "DetectorName", axis: "AxisName") -> "StageRun":
    """Return the readings of one detector axis and of the stage: from a two-column CSV, or live
    while a person moves the stage."""
    from stepdiag.base.files import read_text
    from stepdiag.fourdof.commissioning import parse_stage_run

    if source.suffix.lower() != ".toml":
        return parse_stage_run(read_text(source), source.name)
    return _stage_live(source, detector, axis)


def _stage_live(source: Path, detector: "DetectorName", axis: "AxisName") -> "StageRun":
    import numpy as np

    from stepdiag.fourdof.commissioning import StageRun
    from stepdiag.texts.texts import UNITS

    first = 3 * ("qd", "psd1", "psd2").index(detector)
    rows = []
    unit = "um" if detector == "qd" else "arcsec"
    while True:
        typed = typer.prompt(
            shown(message("ask-reference", name=f"{detector}.{axis}", unit=UNITS[unit])),
            default="",
            show_default=False,
        )
        if not typed.strip():
            break
        try:
            reference = float(typed)
        except ValueError:
            print_words(
                message("such-as", what=message("a-number"), example="-650"), err=True
            )
            continue
        mean = head_record(source, STAGE_S).channels.mean(axis=0)
        rows.append(
            (float(mean[first + ("x", "y").index(axis)] / mean[first + 2]), reference)
        )
    reading, reference_column = np.array(rows).reshape(-1, 2).T
    return StageRun(reading=reading, reference=reference_column, unit=unit)  # type: ignore[arg-type]


def curves_of_logs(paths: list[Path]) -> "Curves":
    """Return the head's functions in logs for comparison: straightness in um, angles in
    arc-seconds."""
    from stepdiag.fourdof.runs import mean_straightness
    from stepdiag.solver.fourdof.head import URAD_PER_ARCSEC

    measured = head_of_logs(paths)
    angles = {
        name: (known.position_mm, known.value_urad / URAD_PER_ARCSEC)
        for name, known in measured.angles.items()
    }
    return {**mean_straightness(measured), **angles}
