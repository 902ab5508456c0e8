"""Supervision of the daemon: its workers, its disk, its clocks, and systemd's watchdog."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

import structlog

from stepdiag.base.messages import Message, Words, message
from stepdiag.daq.service.metrics import GB, Tally, disk_free_bytes, words_on_disk
from stepdiag.daq.service.notify import Notifier
from stepdiag.daq.timing.host_clock import ClockWatch

LOOK_S = 1.0
"""Longest period of the checks in s; systemd's watchdog may need a shorter period."""
STOOD_S = 2.0
"""Least delay in s of a check that shows that this process, or the whole computer, stood still."""
_log = structlog.get_logger("daemon")


class Supervisor:
    """Feeds the watchdog while no worker is dead.

    ``dead`` returns the names of dead workers, with the reason of the end if known. ``remark``
    writes a line for the viewer into the open log. ``require_folder`` raises DeviceError for a
    missing folder of the survey.
    """

    def __init__(
        self,
        notifier: Notifier,
        dead: Callable[[], list[str]],
        remark: Callable[[Message], None],
        tally: Tally,
        require_folder: Callable[[], None],
        folder: Path,
        min_free_gb: float,
    ) -> None:
        self._require_folder = require_folder
        self._notifier = notifier
        self._dead = dead
        self._remark = remark
        self._tally = tally
        self._folder = folder
        self._min_free_gb = min_free_gb
        self._clocks = ClockWatch()
        self.disk: Words = ""
        """The message about a nearly full disk; empty while there is space."""

    async def watch(self) -> None:
        """Check without end. Raises RuntimeError for a dead worker, DeviceError for a missing
        folder of the survey.
        """
        interval_s = min(LOOK_S, (self._notifier.watchdog_s or 2 * LOOK_S) / 2)
        while True:
            await asyncio.sleep(interval_s)
            dead = self._dead()
            if dead:
                raise RuntimeError(f"not alive: {', '.join(dead)}")
            self._require_folder()
            self._look_at_disk()
            self._look_at_clocks(interval_s)
            self._tally.fed_s = time.monotonic()
            self._notifier.alive()

    def _look_at_disk(self) -> None:
        words = words_on_disk(self._folder, self._min_free_gb * (1.1 if self.disk else 1.0))
        if words and not self.disk:
            _log.error(
                "disk-low",
                free_gb=round(disk_free_bytes(self._folder) / GB, 2),
                folder=str(self._folder),
            )
        self.disk = words

    def _look_at_clocks(self, interval_s: float) -> None:
        look = self._clocks.look()
        if look.set_by_s:
            _log.warning("clock-set", by_s=round(look.set_by_s, 1))
            self._remark(message("clock-was-set", by_s=look.set_by_s))
        if look.apart_s > interval_s + STOOD_S:
            _log.warning(
                "stood-still",
                seconds=round(look.apart_s - interval_s, 1),
                asleep_s=round(look.asleep_s, 1),
            )
            self._remark(
                message(
                    "stood-still", seconds_s=look.apart_s - interval_s, asleep_s=look.asleep_s
                )
            )
