"""An export in the report: its files with their hashes, and the effect of its tables on the
tool."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from stepdiag.base.result.result import Result
from stepdiag.conclusion import Export, export_of, harmed_in, reach_of
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import UNTESTED, is_restore
from stepdiag.exporters.files.sets import read_given, read_set
from stepdiag.exporters.profiles.file import load_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS
from stepdiag.exporters.safety.verify import controller_for, verify_files
from stepdiag.exporters.tables import lattice
from stepdiag.exporters.tables.tables import Table, mean_correction_um
from stepdiag.report.drawings.figures import Correction


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFile:
    name: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """An export for a control: its files, and the effect of their tables on the tool (None without
    tables)."""

    controller: str
    files: tuple[ExportedFile, ...]
    correction: Correction | None = None
    concluded: Export | None = None
    """The outcome of the export for the conclusion, or None without a table."""


def exported_of(written: ExportReport) -> Exported:
    files = read_set(written.out_dir)
    lattices = [
        file for file in files if lattice.recognises(file) and not is_restore(file.name)
    ]
    correction = (
        lattice.parse(lattices[0]).correction_um if lattices else _of_tables(written.tables)
    )
    return Exported(
        controller=written.controller,
        files=_listed(files),
        correction=correction,
        concluded=export_of(written),
    )


def exported_in(result: Result, paths: Sequence[Path], profile: Path | None) -> Exported:
    """Return an export from files, or from the folder of an export. All files are listed; the
    prediction uses the files of a control except the restore files.

    Raises ``UsageError`` for an unreadable file, ``DataError`` for damaged tables or files of two
    controls, ``SafetyError`` for a set that differs from its export.
    """
    files = read_given(paths)
    tables = [file for file in files if _is_table(file) and not is_restore(file.name)]
    if not tables:
        return Exported(controller="", files=_listed(files))
    if len(tables) == 1 and lattice.recognises(tables[0]):
        lone = verify_files(result, tables)
        reach = reach_of(lone.prediction.predicted)
        return Exported(
            controller=lattice.NAME,
            files=_listed(files),
            correction=lattice.parse(tables[0]).correction_um,
            concluded=Export(
                controller=lattice.NAME, reach=reach, harmed=harmed_in(lone.findings)
            ),
        )
    known = (
        load_profile(profile, controller_for(tables), result.volume)
        if profile is not None
        else None
    )
    found = verify_files(result, tables, known)
    kinds = tuple(dict.fromkeys(table.kind for table in found.tables))
    untested = (
        kinds if any(Path(file.name).stem.endswith(UNTESTED) for file in tables) else ()
    )
    reach = reach_of(found.prediction.predicted)
    concluded = Export(
        controller=found.controller,
        untested=untested,
        reach=reach,
        harmed=harmed_in(found.findings),
    )
    return Exported(
        controller=found.controller,
        files=_listed(files),
        correction=_of_tables(found.tables),
        concluded=concluded,
    )


def _is_table(file: ControlFile) -> bool:
    return lattice.recognises(file) or any(
        controller.recognises(file) for controller in CONTROLLERS.values()
    )


def _listed(files: Sequence[ControlFile]) -> tuple[ExportedFile, ...]:
    return tuple(
        ExportedFile(
            name=one.name,
            size_bytes=len(one.data),
            sha256=hashlib.sha256(one.data).hexdigest(),
        )
        for one in files
    )


def _of_tables(tables: Sequence[Table]) -> Correction | None:
    return partial(mean_correction_um, tables) if tables else None
