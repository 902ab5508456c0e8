"""The file with the next passes of a survey, beside the logs."""

from pathlib import Path

import msgspec

from stepdiag.base.errors import StepdiagError
from stepdiag.base.files import read_bytes, write_atomically
from stepdiag.daq.records.status import AheadStatus
from stepdiag.daq.records.survey_folder import AHEAD

LARGEST_BYTES = 100_000
"""Largest size of the file in bytes; a larger file was not written by this program."""


def write_ahead(folder: Path, ahead: AheadStatus) -> None:
    """Write the file with the next passes, complete or not at all. Raises UsageError if the folder
    cannot be written.
    """
    write_atomically(folder / AHEAD, msgspec.json.encode(ahead))


def ahead_in(folder: Path) -> AheadStatus:
    """Return the next passes stored in a folder; empty if the file is missing or damaged."""
    try:
        return msgspec.json.decode(
            read_bytes(folder / AHEAD, largest=LARGEST_BYTES), type=AheadStatus
        )
    except (StepdiagError, OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return AheadStatus()
