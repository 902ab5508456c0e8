"""The operator's announcement that a machine without signals will drive a certain setup next.

The file ``begun.jsonl`` beside the lock holds one JSON object per line. Lines are only appended,
and a daemon reads new lines while it runs.
"""

import time
from pathlib import Path

import msgspec
import structlog

from stepdiag.base.files import read_bytes
from stepdiag.daq.recording.verdicts import LARGEST_BYTES, append_line

BEGUN = "begun.jsonl"
OLD_S = 30.0
"""Age in s above which an announcement was meant for an earlier daemon."""
_log = structlog.get_logger("begun")


class Begun(msgspec.Struct, frozen=True, kw_only=True):
    """The beginning of a setup: operator, setup and time (seconds since 1970)."""

    setup: str
    name: str
    time_s: float


def ask_to_begin(folder: Path, setup: str, name: str) -> None:
    """Append the beginning of a setup to the file; the line is on disk when this returns. Raises
    UsageError if the file cannot be written.
    """
    append_line(
        folder / BEGUN, msgspec.json.encode(Begun(setup=setup, name=name, time_s=time.time()))
    )


class BegunWords:
    """Reads the announcements that are added to the file of a folder from now on."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / BEGUN
        self._size = self._length()

    def news(self) -> list[Begun]:
        """Return the announcements added since the last call."""
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
        try:  # the file is queried only once, because this runs ten times a second
            return self._path.stat().st_size
        except OSError:
            return 0
