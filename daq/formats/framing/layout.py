"""The numbers inside binary frames of fixed size."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, message
from stepdiag.daq.formats.framing.frames import Frames

ByteOrder = Literal["little", "big"]
NAMES = ("position", "counter", "beam", "status", "skip")
_FIELD = re.compile(
    r"\s*(?P<name>[a-z]+)\s+(?:(?P<kind>[uif])(?P<bits>8|16|24|32|40|48|56|64)|(?P<count>[0-9]{1,"
    r"3}))\s*\Z"
)


@dataclass(frozen=True, slots=True)
class Place:
    """A number in a frame: its first byte, its length in bytes, and its kind: unsigned (u), signed
    (i) or real (f).
    """

    at: int
    size: int
    kind: str

    def column(
        self, frames: Frames, order: ByteOrder
    ) -> NDArray[np.float64] | NDArray[np.int64]:
        """Return the values of the number in all frames, shape (frames,). Whole numbers are int64
        (an unsigned number above the range of int64 wraps), real numbers are float64.
        """
        raw = frames[:, self.at : self.at + self.size]
        if order == "big":
            raw = raw[:, ::-1]
        if self.kind == "f":
            kind = f"<f{self.size}"
            with np.errstate(invalid="ignore"):  # the received bytes may be a signalling NaN
                return np.ascontiguousarray(raw).view(kind).ravel().astype(np.float64)
        wide = np.zeros((len(frames), 8), dtype=np.uint8)
        wide[:, : self.size] = raw
        if self.kind == "i":
            wide[:, self.size :] = np.where(raw[:, -1:] & 0x80, 0xFF, 0)
        return wide.view("<i8").ravel()


def read_layout(texts: tuple[str, ...], start: int) -> tuple[dict[str, Place], int]:
    """Return the places of the numbers by name, and the byte after the last number. ``texts``
    describe the numbers in order (``position i32``, ``skip 2``); the first number begins at byte
    ``start``.

    Raises UsageError that contains the invalid text.
    """
    places: dict[str, Place] = {}
    at = start
    for text in texts:
        found = _FIELD.match(text)
        if (
            found is None
            or found["name"] not in NAMES
            or (found["name"] == "skip") != (found["count"] is not None)
        ):
            raise _refused(message("layout-field", text=text, names=NAMES[:-1]))
        size = int(found["count"] or int(found["bits"]) // 8)
        if found["kind"] == "f" and size not in (4, 8):
            raise _refused(message("layout-real", text=text))
        if found["name"] in places:
            raise _refused(message("layout-twice", text=text, name=found["name"]))
        if found["name"] != "skip":
            places[found["name"]] = Place(at, size, found["kind"])
        at += size
    return places, at


def _refused(why: Message) -> UsageError:
    return UsageError(
        "survey: laser.frames.layout", expected=message("fields-such-as"), found=why
    )
