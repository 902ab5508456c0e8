"""A report made from its source files, also for the verification of a certificate."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.files import read_text
from stepdiag.base.readings.readings import parse_readings
from stepdiag.base.result.result import Result, result_in
from stepdiag.conclusion import conclude
from stepdiag.exporters.files.sets import SUMS
from stepdiag.report.certificate import AsLeft, as_left, read_letterhead
from stepdiag.report.document import Report, build_report
from stepdiag.report.exported import Exported, exported_in
from stepdiag.report.laboratory import read_laboratory, sha256_of
from stepdiag.texts.texts import Language


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportFiles:
    """The sources of a report: ``result`` and ``left`` are files of results, ``files`` are files or
    folders of exports."""

    result: Path
    files: Sequence[Path] = ()
    profile: Path | None = None
    left: Path | None = None
    letterhead: Path | None = None
    laboratory: Path | None = None
    readings: Path | None = None
    language: Language = "en"


def report_from(of: ReportFiles) -> Report:
    """Return the report of a result with all its sources; the same files give the same bytes in any
    folder.

    The files of a folder count as one export. Raises a StepdiagError for a file that is unreadable
    or belongs to another result.
    """
    found = result_in(of.result)
    exported = [exported_in(found, each, of.profile) for each in _exports(of.files)]
    return build_report(
        found,
        source=of.result.name,
        exported=exported,
        left=None if of.left is None else _as_left(found, exported, result_in(of.left)),
        letterhead=None if of.letterhead is None else read_letterhead(of.letterhead),
        readings=None
        if of.readings is None
        else parse_readings(read_text(of.readings), of.readings.name),
        laboratory=read_laboratory(of.laboratory).file,
        sha256=sha256_of(of.result),
        language=of.language,
    )


def _exports(paths: Sequence[Path]) -> list[list[Path]]:
    folders: dict[Path, list[Path]] = {}
    for path in paths:
        folders.setdefault(path if path.is_dir() else path.parent, []).append(path)
    return [
        [folder] if any(path.name == SUMS for path in each) else each
        for folder, each in folders.items()
    ]


def _as_left(before: Result, exported: Sequence[Exported], after: Result) -> AsLeft:
    known = conclude(before, [one.concluded for one in exported if one.concluded is not None])
    return as_left(after.source, conclude(after), known.reach, after)
