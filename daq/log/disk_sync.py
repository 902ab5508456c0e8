"""Waiting for the disk in a separate thread: a sync takes 3 ms in the median and 140 ms at worst
(baselines.md).

During a sync the recorder passes bytes to the operating system, where the bytes survive the end of
the process.
"""

import threading

from stepdiag.daq.log.part_file import PartFile


class DiskSync:
    """Syncs one file at a time on request. Only the thread of the recorder calls the methods."""

    def __init__(self) -> None:
        self._file: PartFile | None = None
        self._error: Exception | None = None
        self._wanted = self._done = 0
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="recorder-sync", daemon=True)
        self._thread.start()

    def request(self, file: PartFile) -> None:
        """Sync the bytes drained into ``file`` until now, after a running sync has ended. Raises
        the error of the previous sync.
        """
        with self._changed:
            error, self._error = self._error, None
            self._file = file
            self._wanted += 1
            self._changed.notify_all()
        if error is not None:
            raise error

    def settle(self) -> None:
        """Wait until every requested sync is done, so that the file may be closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._done == self._wanted)

    def close(self) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while (due := self._wait()) is not None:
            number, file = due
            error: Exception | None = None
            try:
                file.sync()
            except Exception as raised:  # noqa: BLE001 - raised again where it is heard, in the recorder
                error = raised
            with self._changed:
                self._error = self._error or error
                self._done = number
                self._changed.notify_all()

    def _wait(self) -> tuple[int, PartFile] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._wanted > self._done or self._closing)
            return (
                (self._wanted, self._file)
                if self._file is not None and self._wanted > self._done
                else None
            )
