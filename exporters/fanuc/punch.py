"""FANUC punch files: an export changes only digits after a P.

Source: 31 machine dumps, compared byte by byte (controllers.md 2.6). Blocks end with LF CR CR, and
the file begins and ends with ``%``. The file contains no ``;``, ``+``, ``?`` and no lower case. New
generation (0i-D/F, 30i): ``N01825Q1A1P3000A2P3000``; old generation (16i/18i): ``N01825 A1 P 3000
A2 P 3000``. Pitch data have the block number ``N(10000 + point)`` and a P without an axis. On new
controls parameters also have numbers above 10000, and carry Q1: a line with Q1 is never pitch data.
The text between N and P is copied from the machine's own file.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from stepdiag.base.errors import DataError, SafetyError
from stepdiag.base.messages import excerpt, message
from stepdiag.exporters.files.control_file import ControlFile

FIRST_PITCH_LINE = 10000
EOB = b"\n\r\r"
_NUMBER = re.compile(rb"^N\s*(\d{1,9})(?!\d)")
_PARAMETER_KIND = re.compile(rb"^N\s*\d+\s*Q\s*1(?!\d)")
_BARE_VALUE = re.compile(
    rb"^(?P<head>N\s*\d+\s*(?:Q\s*\d+\s*)?P\s*)(?P<value>-?\d{1,9})(?P<tail>\s*)\Z"
)
_PATH_VALUE = re.compile(
    rb"^(?P<head>N\s*\d+\s*(?:Q\s*\d+\s*)?(?:L\s*\d+\s*)?P\s*)(?P<value>-?[\d.]+)(?P<tail>\s*)\Z"
)
_FORBIDDEN = re.compile(rb"[a-z;?+]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A block of a punch file: its bytes and its N number (None for a block without N)."""

    text: bytes
    number: int | None
    where: str


@dataclass(frozen=True, kw_only=True)
class PunchFile:
    name: str
    blocks: tuple[Block, ...]

    @cached_property
    def pitch(self) -> Mapping[int, int]:
        """Return the stored increments of the file by point number."""
        found: dict[int, int] = {}
        for block in self.blocks:
            if (match := _pitch_value(block)) is not None and block.number is not None:
                point = block.number - FIRST_PITCH_LINE
                if point in found:
                    raise DataError(
                        block.where,
                        expected=message("point-once"),
                        found=message("point-again", number=point),
                    )
                found[point] = int(match["value"])
        return found

    def parameter(self, number: int, axis: int | None) -> str | None:
        """Return the text of a parameter of one axis (``A<axis>``) or of a parameter without axes,
        None if the file does not contain it.
        """
        for block in self.blocks:
            if block.number == number and (match := _parameter_value(block.text, axis)):
                return match["value"].decode("ascii")
        return None

    def changed(
        self, pitch: Mapping[int, int], parameters: Mapping[tuple[int, int | None], str]
    ) -> bytes:
        """Return the bytes of the file with new pitch data and new parameters, which are given by
        number and axis.

        Only digits after a P change, and only for numbers in the file, because the control refuses
        unknown numbers. Raises ``SafetyError`` for a pitch point that the file lacks.
        """
        missing = sorted(set(pitch) - set(self.pitch))
        if missing:
            raise SafetyError(
                self.name,
                code="template-missing.points",
                expected=message("line-each"),
                found=message("none-for", points=[str(each) for each in missing[:6]]),
                remedy=message("range-own"),
            )
        return EOB.join(_rewritten(block, pitch, parameters) for block in self.blocks)


def read_punch(file: ControlFile) -> PunchFile:
    """Return the blocks of a punch file. Raises ``DataError`` for bytes that the control would
    misread.
    """
    data = file.data
    if EOB not in data or re.search(rb"[\r\n]", data.replace(EOB, b"")):
        raise DataError(
            file.name,
            expected=message("line-ends-of-blocks"),
            found=message("line-ends"),
            remedy=message("copy-file-from-memory"),
        )
    blocks = tuple(
        Block(
            text=text,
            number=int(match[1]) if (match := _NUMBER.match(text)) else None,
            where=f"{file.name}: line {line}",
        )
        for line, text in enumerate(data.split(EOB), start=1)
    )
    _refuse_foreign(file.name, blocks)
    return PunchFile(name=file.name, blocks=blocks)


def _refuse_foreign(name: str, blocks: tuple[Block, ...]) -> None:
    marks = [index for index, block in enumerate(blocks) if b"%" in block.text]
    filled = [index for index, block in enumerate(blocks) if block.text.strip()]
    if len(marks) != 2 or not filled or marks != [filled[0], filled[-1]]:
        raise DataError(
            name,
            expected=message("percent-at-ends-alone"),
            found=message("percent-lines", count=len(marks)),
            remedy=message("percent-ends"),
        )
    for block in blocks:
        bad = _FORBIDDEN.search(block.text)
        if bad or not block.text.isascii():
            raise DataError(
                block.where,
                expected=message("capital-letters"),
                found=excerpt(repr(block.text)),
            )


def _pitch_value(block: Block) -> re.Match[bytes] | None:
    if (
        block.number is None
        or block.number < FIRST_PITCH_LINE
        or _PARAMETER_KIND.match(block.text)
    ):
        return None
    return _BARE_VALUE.match(block.text)


def _parameter_value(text: bytes, axis: int | None) -> re.Match[bytes] | None:
    if axis is None:
        return _PATH_VALUE.match(text)
    return re.match(
        rb"^(?P<head>.*?A\s*%d\s*P\s*)(?P<value>-?[\d.]+)(?P<tail>.*)\Z" % axis, text
    )


def _rewritten(
    block: Block, pitch: Mapping[int, int], parameters: Mapping[tuple[int, int | None], str]
) -> bytes:
    text = block.text
    match = _pitch_value(block)
    if match is not None and block.number is not None:
        value = pitch.get(block.number - FIRST_PITCH_LINE)
        return (
            text
            if value is None
            else match["head"] + str(value).encode("ascii") + match["tail"]
        )
    for (number, axis), value_text in parameters.items():
        if number == block.number and (found := _parameter_value(text, axis)):
            text = found["head"] + value_text.encode("ascii") + found["tail"]
    return text
