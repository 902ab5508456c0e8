"""Telling the machine that its stop is captured and that it may move on."""

from collections.abc import Callable

from stepdiag.daq.capture.stop import CapturedStop
from stepdiag.daq.formats.signals import Signals


class Handshake:
    """Tells each stop once. ``tell`` takes a stop count; ``owed`` is that of the last stop in the logs, in case a daemon died before it
    told the machine.
    """

    def __init__(self, tell: Callable[[int], None], owed: int | None) -> None:
        self._tell = tell
        self._owed = owed

    def captured(self, stop: CapturedStop) -> None:
        """Take a stop; one that was recovered afterwards has been left long ago."""
        if stop.stop_count is not None and not stop.recovered:
            self._owed = None
            self._tell(stop.stop_count)

    def look(self, signals: Signals | None) -> None:
        """Tell a machine that stands at the stop that is owed."""
        if self._owed is not None and signals is not None and signals.stopped and signals.stop_count == self._owed:
            self._tell(self._owed)
            self._owed = None
