"""The public Python door: readings in, result out; files and their prediction; a log as numpy arrays.

    >>> from stepdiag.api import load_readings, solve
    >>> result = solve(load_readings(READINGS))
    >>> print(f"{result.squareness['C0Y'].value:.1f} urad")
    -20.0 urad

Everything here is kept from version to version; what the floors' rooms hold beside it may move.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepdiag.base.files import read_hashed, read_text, write_hashed
from stepdiag.base.readings.readings import Readings, in_mm, make_readings, parse_readings, render_readings
from stepdiag.base.result.result import Result, parse_result
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.records.events import Chunk, LinkEvent
from stepdiag.daq.replay import replay
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.formats import laser_decoder
from stepdiag.daq.timing.samples import Samples
from stepdiag.exporters.export.export import export as export_files
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.verify import Verification, controller_for, verify_files
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import Angles, parse_angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.straightness_file import parse_straightness

__all__ = [
    "Readings",
    "RecordedLog",
    "Result",
    "export",
    "load_angles",
    "load_readings",
    "load_result",
    "load_straightness",
    "make_readings",
    "read_log",
    "render_readings",
    "save_result",
    "solve",
    "verify",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedLog:
    """One log in numbers. ``laser`` holds every sample in columns; ``stops`` what the synchroniser made of them, in order."""

    laser: Samples
    stops: tuple[CapturedStop, ...]


def load_readings(path: Path | str) -> Readings:
    """Return the readings of a CSV file (columns setup, pass, stop, x_mm, y_mm, z_mm, reading_mm and more).

    Raises ``UsageError`` for a file that cannot be read, ``DataError`` with row and field for one that is no table of readings.
    """
    return in_mm(parse_readings(read_text(Path(path)), Path(path).name), Path(path).name)


def load_angles(path: Path | str) -> Angles:
    """Return angular functions of a CSV file (axis, position_mm, EA_urad, EB_urad, EC_urad). Raises as `load_readings`."""
    return parse_angles(read_text(Path(path)), Path(path).name)


def load_straightness(path: Path | str) -> tuple[MeasuredStraightness, ...]:
    """Return straightness functions of a CSV file (position_mm, EYX_um, u_EYX_um ..). Raises as `load_readings`."""
    return parse_straightness(read_text(Path(path)), Path(path).name)


def load_result(path: Path | str) -> Result:
    """Return a result that `save_result`, ``stepdiag solve`` or ``stepdiag run`` wrote. Raises as `load_readings`."""
    return parse_result(read_hashed(Path(path)), Path(path).name)


def save_result(result: Result, path: Path | str) -> None:
    """Write a result as JSON; the same result gives the same bytes. Raises ``UsageError`` where another file is in its place."""
    write_hashed(Path(path), result.to_json())


def export(
    result: Result,
    controller: str,
    out_dir: Path | str,
    *,
    profile: Path | str | None = None,
    step_mm: float | None = None,
    accept: Collection[str] = (),
) -> ExportReport:
    """Write the compensation files of a result for a control and return what was written and what it will do.

    ``profile`` is the machine's profile (``stepdiag profile`` writes one); without it this is a quick look, with the
    tables at the measured positions or in steps of ``step_mm``. ``accept`` names the warnings that may pass.
    Raises ``SafetyError`` for a failed check, ``DataError`` for what is not identified.
    """
    found = load_profile(Path(profile), controller_named(controller), result.volume) if profile is not None else None
    return export_files(result, controller, found, step_mm=step_mm, accept=accept, out_dir=Path(out_dir))


def verify(result: Result, files: Sequence[Path | str], *, profile: Path | str | None = None) -> Verification:
    """Return what the files of one control will do to the machine of a result. Raises ``DataError`` for files of no known control."""
    read = read_given([Path(file) for file in files])
    found = load_profile(Path(profile), controller_for(read), result.volume) if profile is not None else None
    return verify_files(result, read, found)


def read_log(path: Path | str) -> RecordedLog:
    """Return a log as numpy arrays: every sample of its laser, decoded again from the raw bytes, and its stops.

    Raises ``DataError`` for a file that is no log of ours.
    """
    log = open_log(Path(path))
    decoder = laser_decoder(parse_survey(log.header.survey_text, f"{Path(path).name}: survey.toml"))
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
    return RecordedLog(laser=_joined(batches), stops=tuple(each for each in outcomes if isinstance(each, CapturedStop)))


def _joined(batches: Sequence[Samples]) -> Samples:
    """Return batches as one, their remarks left out: the replay tells them."""
    return Samples(
        counter=np.concatenate([batch.counter for batch in batches]),
        position_mm=np.concatenate([batch.position_mm for batch in batches]),
        beam=np.concatenate([batch.beam for batch in batches]),
        flags=np.concatenate([batch.flags for batch in batches]),
        arrival_ns=np.concatenate([batch.arrival_ns for batch in batches]),
    )
