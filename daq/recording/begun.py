"""The operator's announcement of the next setup of a machine without signals.

The file ``begun.jsonl`` in the survey's folder contains one JSON object per line. Lines are only
appended, and a running daemon reads new lines.
"""

import time
from pathlib import Path

import msgspec
import structlog

from stepdiag.base.files import read_bytes
from stepdiag.daq.recording.verdicts import LARGEST_BYTES, append_line

BEGUN = "begun.jsonl"
OLD_S = 30.0
"""Age in s above which an announcement is ignored, because it was meant for an earlier daemon."""
_log = structlog.get_logger("begun")


class Begun(msgspec.Struct, frozen=True, kw_only=True):
    """The announcement of a setup: operator, setup and time (seconds since 1970)."""

    setup: str
    name: str
    time_s: float


def ask_to_begin(folder: Path, setup: str, name: str) -> None:
    """Append the announcement of a setup to the file, and wait until the line is on disk. Raises
    UsageError if the file cannot be written.
    """
    append_line(
        folder / BEGUN, msgspec.json.encode(Begun(setup=setup, name=name, time_s=time.time()))
    )


class BegunWords:
    def __init__(self, folder: Path) -> None:
        self._path = folder / BEGUN
        self._size = self._length()

    def news(self) -> list[Begun]:
        before, self._size = self._size, self._length()
        if self._size <= before:
            return []
        words = []
        for line in read_bytes(self._path, largest=LARGEST_BYTES)[before:].splitlines():
            try:
                words.append(msgspec.json.decode(line, type=Begun))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                _log.warning("begun-not-read", file=str(self._path), reason=str(error))
        return [word for word in words if abs(time.time() - word.time_s) < OLD_S]

    def _length(self) -> int:
        try:  # one query of the file is enough, because this runs ten times a second
            return self._path.stat().st_size
        except OSError:
            return 0
