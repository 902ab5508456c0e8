"""Whether the machine's signals are of now: a heartbeat that stands still means registers that nobody writes any more."""

from stepdiag.daq.formats.signals import Signals
from stepdiag.daq.records.events import ModbusBlock

STILL_NS = 1_500_000_000
"""The heartbeat changes at least once a second (contract 2); polls and a slow gateway are allowed for by half as much again."""


class Pulse:
    """Follows the heartbeat of one log. ``still`` tells that it has stood for too long; a machine without one is believed."""

    def __init__(self) -> None:
        self.still = False
        self.beat_ns = 0
        """The request of the poll that saw it change last: what was read then was of that moment."""
        self._value: int | None = None
        self._heard_ns = 0

    def take(self, signals: Signals, block: ModbusBlock) -> bool:
        """Take a poll; return whether the heartbeat has just been found to stand still."""
        if signals.heartbeat is None or signals.heartbeat != self._value:
            self._value, self.beat_ns, self._heard_ns = signals.heartbeat, block.send_ns, block.recv_ns
            self.still = False
            return False
        before, self.still = self.still, block.recv_ns - self._heard_ns > STILL_NS
        return self.still and not before

    def for_s(self, now_ns: int) -> float:
        """Return for how long it has stood."""
        return (now_ns - self._heard_ns) * 1e-9
