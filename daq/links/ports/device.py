"""The device under a port: a descriptor that delivers bytes. `stepdiag.daq.links.ports.port` waits
for its bytes.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

from stepdiag.base.messages import Message

LARGEST_READ = 65536
BUSY_WAIT_S = 0.1
"""Wait of a read in s on a line that is expected to deliver bytes at any moment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """A port and how its line is driven. uMD boards need DTR and RTS asserted."""

    port: str
    baud: int = 115200
    bytesize: Literal[7, 8] = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    dtr: bool = True
    rts: bool = True


LossKind = Literal["lost-port", "lost-system", "lost-framing", "lost-parity", "lost-break"]
"""The message of a loss of bytes."""


class Device(Protocol):
    """An open line, used by one thread."""

    detail: Message
    """The line in words, shown to the operator when the line is open."""
    low_latency: bool
    """Whether bytes come through at once, instead of after the 16 ms that a USB adapter may sit on
    them."""

    def fileno(self) -> int:
        """Return the descriptor on which poll(2) waits for bytes."""
        ...

    def read(self, *, ready: bool) -> bytes:
        """Return what there is; nothing where nothing came within `BUSY_WAIT_S`, or what came was
        no data of the line.

        ``ready`` is what poll(2) returned. Raises OSError where the line is gone.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send ``data``. Raises OSError where the line is gone."""
        ...

    def lost(self) -> dict[LossKind, int]:
        """Return the number of losses since the line was opened, by kind, as the line counts them;
        empty for a line that does not count. Any thread.
        """
        ...

    def close(self) -> None:
        """Close it."""
        ...
