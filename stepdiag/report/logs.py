"""The logs that a result rests on, as the annex lists them: which file, how large, and its hash."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepdiag.daq.records.survey_folder import logs_in
from stepdiag.report.exported import ExportedFile
from stepdiag.report.sections import Table


def logs_beside(folder: Path) -> tuple[ExportedFile, ...]:
    """Return the logs in a folder with their sizes and hashes, in the order of their recording; none where there are none."""
    return tuple(_hashed(path) for path in logs_in(folder))


def _hashed(path: Path) -> ExportedFile:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return ExportedFile(name=path.name, size_bytes=path.stat().st_size, sha256=digest)


def logs_table(logs: Sequence[ExportedFile], words: Mapping[str, str]) -> Table | None:
    """Return the logs as a table; None where there are none."""
    rows = [(one.name, str(one.size_bytes), one.sha256) for one in logs]
    return Table(header=(words["file"], words["bytes"], "SHA-256"), rows=rows) if rows else None
