"""The logs that a result rests on, as the annex lists them: which file, and the hash of all that it says."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from stepdiag.daq.recording.archive import digest
from stepdiag.daq.records.survey_folder import logs_in
from stepdiag.report.sections import Table

Recorded = tuple[str, str]
"""Name and SHA-256 of a log, empty for a damaged one."""


def logs_beside(folder: Path) -> tuple[Recorded, ...]:
    """Return the logs in a folder with their hashes, in the order of their recording; none where there are none.

    Of what the log says, not of the file: a log that was packed since is the same log, and its replay writes the same report.
    """
    return tuple((path.name, digest(path)) for path in logs_in(folder))


def logs_table(logs: Sequence[Recorded], words: Mapping[str, str]) -> Table | None:
    """Return the logs as a table; None where there are none."""
    return Table(header=(words["file"], "SHA-256"), rows=[(name, digest or words["damaged"]) for name, digest in logs]) if logs else None
