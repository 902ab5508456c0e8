"""The public Python interface: from readings to a result; compensation files and their predicted
effect; a log as numpy arrays; tables and plots of these objects.

    >>> from stepdiag.api import load_readings, solve
    >>> result = solve(load_readings(READINGS))
    >>> print(f"{result.squareness['C0Y'].value:.1f} urad")
    -20.6 urad

Everything in this module stays compatible from version to version; other functions may change.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from stepdiag.api.plots import plot_closure, plot_field, plot_functions
from stepdiag.api.recorded import RecordedLog, read_log
from stepdiag.api.tables import frame, table
from stepdiag.base.files import read_text, write_hashed
from stepdiag.base.readings.readings import (
    Readings,
    in_mm,
    make_readings,
    parse_readings,
    render_readings,
)
from stepdiag.base.result.result import Result, result_in
from stepdiag.certificate.custody import Verified, verify_certificate
from stepdiag.certificate.written import Beside, write_certificate
from stepdiag.comparing.compare import Comparison, compare
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

if TYPE_CHECKING:
    from stepdiag.solver.planning.planner import Advice

__all__ = [
    "Comparison",
    "Readings",
    "RecordedLog",
    "Result",
    "Verified",
    "certificate",
    "compare",
    "export",
    "frame",
    "load_angles",
    "load_readings",
    "load_result",
    "load_straightness",
    "make_readings",
    "plan",
    "plot_closure",
    "plot_field",
    "plot_functions",
    "read_log",
    "render_readings",
    "report",
    "save_result",
    "solve",
    "table",
    "verify",
    "verify_certificate",
]


def load_readings(path: Path | str) -> Readings:
    """Return the readings of a CSV file (columns setup, pass, stop, x_mm, y_mm, z_mm, reading_mm
    and more).

    Raises ``UsageError`` for an unreadable file, ``DataError`` with row and field for a file that
    is not a table of readings.
    """
    return in_mm(parse_readings(read_text(Path(path)), Path(path).name), Path(path).name)


def load_angles(path: Path | str) -> Angles:
    """Return the angular functions in a CSV file (axis, position_mm, EA_urad, EB_urad, EC_urad).
    Raises the errors of `load_readings`.
    """
    return parse_angles(read_text(Path(path)), Path(path).name)


def load_straightness(path: Path | str) -> tuple[MeasuredStraightness, ...]:
    """Return the straightness functions in a CSV file (position_mm, EYX_um, u_EYX_um ..). Raises
    the errors of `load_readings`.
    """
    return parse_straightness(read_text(Path(path)), Path(path).name)


def load_result(path: Path | str) -> Result:
    """Return a result that `save_result`, ``stepdiag solve`` or ``stepdiag run`` wrote. Raises the
    errors of `load_readings`.
    """
    return result_in(Path(path))


def save_result(result: Result, path: Path | str) -> None:
    """Write a result as JSON; the same result gives the same bytes. Raises ``UsageError`` if
    ``path`` exists with other bytes.
    """
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
    """Write the compensation files of a result for a control; return the files and their predicted
    effect.

    ``profile`` is the machine's profile (written by ``stepdiag profile``). Without a profile the
    export is provisional: its tables are at the measured positions or in steps of ``step_mm``.
    ``accept`` contains the codes of accepted warnings. Raises ``SafetyError`` for a failed check,
    ``DataError`` for an unidentified quantity.
    """
    found = (
        load_profile(Path(profile), controller_named(controller), result.volume)
        if profile is not None
        else None
    )
    return export_files(
        result, controller, found, step_mm=step_mm, accept=accept, out_dir=Path(out_dir)
    )


def verify(
    result: Result, files: Sequence[Path | str], *, profile: Path | str | None = None
) -> Verification:
    """Return the predicted effect of the files of one control on the machine of a result. Raises
    ``DataError`` for files that belong to no known control."""
    read = read_given([Path(file) for file in files])
    found = (
        load_profile(Path(profile), controller_for(read), result.volume)
        if profile is not None
        else None
    )
    return verify_files(result, read, found)


def plan(
    survey: Path | str, *, minutes: float | None = None, target_um: float | None = None
) -> "Advice":
    """Return the forecast of a survey file and the recommended surveys, as printed by ``stepdiag
    plan``.

    ``minutes`` is the available time. ``target_um`` is the largest permitted error after
    compensation (rms over the volume). Raises ``UsageError`` for a file that is not a survey.
    """
    from stepdiag.completion.foreseen import circumstances
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.solver.planning.planner import plan as advise

    found = load_survey(Path(survey))
    return advise(
        found.planned,
        circumstances(found, Path(survey).parent),
        available_min=minutes,
        target_um=target_um,
    )


def report(
    result: Result,
    out: Path | str,
    *,
    readings: Readings | None = None,
    language: Literal["en", "de"] = "en",
    pdf: bool = False,
) -> list[Path]:
    """Write the report of a result; return the paths of the written files. The report is FILE.html,
    FILE.pdf, or a folder with the HTML and every figure as CSV.

    Raises ``UsageError`` if the folder for the report is an existing file, or for a PDF without an
    installed browser.
    """
    from stepdiag.report.document import build_report
    from stepdiag.report.output import write_report

    return write_report(
        build_report(result, source=result.source, readings=readings, language=language),
        Path(out),
        pdf=pdf,
    )


def certificate(
    result: Path | str,
    out: Path | str,
    *,
    files: Sequence[Path | str] = (),
    laboratory: Path | str | None = None,
    report: Path | str | None = None,
    left: Path | str | None = None,
) -> int:
    """Write the digital calibration certificate (DCC) of a result's file; return the number of
    sources in the certificate. The certificate contains the SHA-256 of each source.

    ``files`` are the files of an export. ``laboratory`` is the laboratory's file. ``report`` is the
    output of ``stepdiag report``. ``left`` is the file with the result of a survey that was
    measured after loading. Raises ``UsageError`` for an existing certificate, ``DataError`` for
    files that do not belong to the result.
    """
    stated, shown, after = (
        None if path is None else Path(path) for path in (laboratory, report, left)
    )
    beside = Beside(
        laboratory=stated, files=[Path(file) for file in files], report=shown, left=after
    )
    return write_certificate(Path(result), result_in(Path(result)), Path(out), beside)
