"""Cuts a stream of bytes into text lines of limited length."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

LINE_CAP = 4096
"""Longest line in bytes, far above the length of a sample of any instrument."""
_QUOTED_BYTES = 40
"""Number of bytes of an invalid line that a message shows."""


class LineBuffer:
    """Stores the incomplete line at the end of a stream.

    ``cap`` is the longest line in bytes without its terminator. The beginning of a line that
    exceeds ``cap`` is returned at once, and the rest of the line is discarded, so that memory is
    limited even at a wrong baud rate. The returned beginning is longer than ``cap``, so the decoder
    refuses it.
    """

    def __init__(self, cap: int, terminator: bytes = b"\n") -> None:
        self.cap = cap
        self._terminator = terminator
        self._parts: list[bytes] = []
        self._held = 0
        self._skipping = False

    def feed(self, chunk: bytes) -> bytes:
        """Return the lines that ``chunk`` completes, with their terminators; empty if no line is
        complete.
        """
        if self._skipping:
            _, found, chunk = chunk.partition(self._terminator)
            if not found:
                return b""
            self._skipping = False
        cut = chunk.rfind(self._terminator) + 1
        complete = b""
        if cut:
            complete = self._take() + chunk[:cut]
        self._hold(chunk[cut:])
        if self._held > self.cap:
            complete += self._take() + self._terminator
            self._skipping = True
        return complete

    def preview(self, chunk: bytes) -> bytes:
        """Return the lines that `feed` would return, without consuming bytes; empty if the present
        line is too long or is being discarded.
        """
        cut = chunk.rfind(self._terminator) + 1
        if self._skipping or len(chunk) - cut > self.cap:
            return b""
        return b"".join(self._parts) + chunk[:cut] if cut else b""

    def skip_line(self) -> None:
        """Discard the bytes up to the next terminator, because the present line is incomplete."""
        self._take()
        self._skipping = True

    def _hold(self, rest: bytes) -> None:
        if rest:
            self._parts.append(rest)
            self._held += len(rest)

    def _take(self) -> bytes:
        held = b"".join(self._parts)
        self._parts.clear()
        self._held = 0
        return held


def quote(raw: bytes) -> str:
    text = raw[:_QUOTED_BYTES].decode("ascii", errors="backslashreplace")
    printable = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
    return f'"{printable}"' + ("..." if len(raw) > _QUOTED_BYTES else "")


def arrivals_of_lines(
    chunks: Sequence[tuple[bytes, int]], terminator: bytes = b"\n"
) -> NDArray[np.int64]:
    """Return the arrival time of every line in ns, shape (lines,). A line arrives with the chunk
    that contains its end; ``chunks`` are pairs of bytes and arrival time in ns.
    """
    return np.repeat(
        np.array([arrival_ns for _, arrival_ns in chunks], dtype=np.int64),
        [chunk.count(terminator) for chunk, _ in chunks],
    )
