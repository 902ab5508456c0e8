"""Cuts a stream of bytes into binary frames of fixed size, and finds the next frame after invalid
bytes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.messages import Message, message

Frames = NDArray[np.uint8]
"""The bytes of whole frames, shape (frames, size)."""

SHOWN = 16
"""Number of bytes outside frames that a message shows."""
JUNK_CAP = 4096
"""Number of bytes without a frame after which a remark is made, also before the first frame."""


@dataclass(frozen=True, slots=True)
class Junk:
    """Bytes outside every frame: their number ``count``, and the first of these bytes. The bytes
    between two frames are reported once.
    """

    count: int
    begins: bytes = b""

    @property
    def why(self) -> Message:
        return (
            message("junk-begins", count=self.count, bytes=self.begins.hex(" "))
            if self.begins
            else message("junk", count=self.count)
        )


class FrameBuffer:
    """Stores the incomplete frame at the end of a stream.

    A frame begins with ``sync``, has ``size`` bytes and passes the check ``valid`` (a function of
    the frame's bytes, shape (size,)). After an invalid frame the search continues one byte further,
    so a sync pattern inside the values of a frame does not cause the loss of a valid frame.
    """

    def __init__(self, sync: bytes, size: int, valid: Callable[[bytes], bool]) -> None:
        self._sync = sync
        self._size = size
        self._valid = valid
        self._held = b""
        self._junk = 0
        self._begins = b""
        self._quoted = False

    def clear(self) -> None:
        self._held = b""

    def feed(self, chunk: bytes) -> Iterator[Frames | Junk]:
        """Yield the frames that ``chunk`` completes, and the junk between frames. The caller must
        exhaust the iterator.
        """
        data = self._held + chunk
        at = 0
        while True:
            start = at
            while len(data) - at >= self._size and self._is_frame(data[at : at + self._size]):
                at += self._size
            if at > start:
                yield from self._report(0)
                self._begins, self._quoted = b"", False
                yield np.frombuffer(
                    data, dtype=np.uint8, count=at - start, offset=start
                ).reshape(-1, self._size)
            if self._may_begin(data[at:]):
                break
            after = self._next_sync(data, at + 1)
            self._junk += after - at
            if not self._quoted:
                self._begins += data[at : min(after, at + SHOWN - len(self._begins))]
            yield from self._report(JUNK_CAP)
            at = after
        self._held = data[at:]

    def _is_frame(self, frame: bytes) -> bool:
        return frame.startswith(self._sync) and self._valid(frame)

    def _may_begin(self, rest: bytes) -> bool:
        return len(rest) < self._size and rest[: len(self._sync)] == self._sync[: len(rest)]

    def _next_sync(self, data: bytes, start: int) -> int:
        found = data.find(self._sync, start)
        if found >= 0:
            return found
        tail = max(start, len(data) - len(self._sync))
        return next(
            (at for at in range(tail, len(data)) if self._sync.startswith(data[at:])),
            len(data),
        )

    def _report(self, cap: int) -> Iterator[Junk]:
        while self._junk and self._junk >= cap:
            portion = cap or self._junk
            self._junk -= portion
            yield Junk(portion, self._begins)
            self._begins, self._quoted = b"", True
