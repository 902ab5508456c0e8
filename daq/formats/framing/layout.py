"""The numbers within binary frames of fixed size: where each stands, and reading a column of them at once."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepdiag.daq.formats.framing.frames import Frames

ByteOrder = Literal["little", "big"]
NAMES = ("position", "counter", "beam", "status", "skip")
_FIELD = re.compile(r"\s*(?P<name>[a-z]+)\s+(?:(?P<kind>[uif])(?P<bits>8|16|24|32|40|48|56|64)|(?P<count>[0-9]{1,3}))\s*\Z")


@dataclass(frozen=True, slots=True)
class Place:
    """A number in a frame: its first byte, its length, and whether it is unsigned (u), signed (i) or real (f)."""

    at: int
    size: int
    kind: str

    def column(self, frames: Frames, order: ByteOrder) -> NDArray[np.float64] | NDArray[np.int64]:
        """Return the number of every frame, shape (frames,): whole ones as int64 (unsigned beyond that wrap), real ones as float64."""
        raw = frames[:, self.at : self.at + self.size]
        if order == "big":
            raw = raw[:, ::-1]
        if self.kind == "f":
            kind = f"<f{self.size}"
            with np.errstate(invalid="ignore"):  # a signalling NaN of the wire
                return np.ascontiguousarray(raw).view(kind).ravel().astype(np.float64)
        wide = np.zeros((len(frames), 8), dtype=np.uint8)
        wide[:, : self.size] = raw
        if self.kind == "i":
            wide[:, self.size :] = np.where(raw[:, -1:] & 0x80, 0xFF, 0)
        return wide.view("<i8").ravel()


def read_layout(texts: tuple[str, ...], start: int) -> tuple[dict[str, Place], int]:
    """Return the places by name and where the last one ends. ``texts`` are such as ``position i32`` or ``skip 2``, the first at ``start``.

    Raises ValueError with what is wrong, in words.
    """
    places: dict[str, Place] = {}
    at = start
    for text in texts:
        found = _FIELD.match(text)
        if found is None or found["name"] not in NAMES or (found["name"] == "skip") != (found["count"] is not None):
            raise ValueError(f"{text!r}: a name ({', '.join(NAMES[:-1])}) and u8 to u64, i8 to i64, f32 or f64; or skip and how many bytes")
        size = int(found["count"] or int(found["bits"]) // 8)
        if found["kind"] == "f" and size not in (4, 8):
            raise ValueError(f"{text!r}: a real number has 32 or 64 bits")
        if found["name"] in places:
            raise ValueError(f"{text!r}: {found['name']} stands there twice")
        if found["name"] != "skip":
            places[found["name"]] = Place(at, size, found["kind"])
        at += size
    return places, at
