"""The present state of the daemon and its links for `status`: a small file beside the lock, written
every second.
"""

import time
from contextlib import suppress
from pathlib import Path

import msgspec

from stepdiag.base.errors import StepdiagError
from stepdiag.base.files import read_bytes
from stepdiag.base.messages import Message, Words
from stepdiag.daq.records.status import LinkStatus

FILE = ".now.json"
OLD_S = 10.0
"""Age in s of the file above which the daemon, or the disk, counts as stopped."""
AT_STOPS = ("waits-taking", "waits-move", "waits-machine")
"""Keys of the messages of a daemon that waits for a stop of a setup."""
LARGEST_BYTES = 100_000
"""Largest size of the file in bytes; a larger file was not written by this program."""


class LiveStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a daemon at the time ``time_s`` (seconds since 1970). ``conditions`` are the
    newest values of air and material from a sensor or the laser.
    """

    time_s: float
    waits_for: Words
    message: Words
    laser: LinkStatus
    plc: LinkStatus
    head: LinkStatus | None = None
    air: LinkStatus | None = None
    conditions: dict[str, float] = {}

    def awaits_stop_of(self, setup: str) -> bool:
        waits = self.waits_for
        return (
            isinstance(waits, Message)
            and waits.key in AT_STOPS
            and waits.arguments["setup"] == setup
        )


def write_live(folder: Path, status: LiveStatus) -> None:
    """Write the state of the daemon, complete or not at all; a refusing disk is ignored."""
    part = folder / f"{FILE}.part"
    try:
        part.write_bytes(msgspec.json.encode(status))
        part.replace(folder / FILE)
    except OSError:
        return


def forget_live(folder: Path) -> None:
    """Remove the file of the state, because the daemon ends. If the disk refuses, the remaining
    file is soon out of date.
    """
    with suppress(OSError):
        (folder / FILE).unlink(missing_ok=True)


def live_in(folder: Path) -> LiveStatus | None:
    """Return the last state of the daemon that records into a folder; None if the file is missing,
    damaged or old.
    """
    if not (folder / FILE).is_file():
        return None
    try:
        status = msgspec.json.decode(
            read_bytes(folder / FILE, largest=LARGEST_BYTES), type=LiveStatus
        )
    except (StepdiagError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return status if abs(time.time() - status.time_s) < OLD_S else None
