"""The device of a port: a descriptor that delivers bytes. `OpenPort` waits for the bytes."""

from dataclasses import dataclass
from typing import Literal, Protocol

from stepdiag.base.messages import Message

LARGEST_READ = 65536
BUSY_WAIT_S = 0.1
"""Longest wait of a read in s on a line that may deliver bytes at any moment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """A port and the settings of its line. uMD boards need DTR and RTS asserted."""

    port: str
    baud: int = 115200
    bytesize: Literal[7, 8] = 8
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    dtr: bool = True
    rts: bool = True


LossKind = Literal["lost-port", "lost-system", "lost-framing", "lost-parity", "lost-break"]
"""Kind of a loss of bytes; each kind is the key of a message."""


class Device(Protocol):
    """An open line, used by one thread."""

    detail: Message
    """Description of the open line for the operator."""
    low_latency: bool
    """Whether received bytes arrive at once; otherwise a USB adapter may delay the bytes by
    16 ms.
    """

    def fileno(self) -> int:
        """Return the descriptor on which poll(2) waits for bytes."""
        ...

    def read(self, *, ready: bool) -> bytes:
        """Return the waiting bytes; empty if no byte of the line arrives within `BUSY_WAIT_S`.

        ``ready`` is the result of poll(2). Raises OSError if the line is lost.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send ``data``. Raises OSError if the line is lost."""
        ...

    def lost(self) -> dict[LossKind, int]:
        """Return the line's counts of losses since its opening, by kind; empty for a line without
        counts. Any thread may call this method.
        """
        ...

    def close(self) -> None: ...
