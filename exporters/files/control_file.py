from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlFile:
    """A file for the control: plain name, exact bytes, and purpose.

    The purpose is ``data`` for a table that ``parse`` reads back, ``program`` for a part program
    that loads a table, ``note`` for a text for people.
    """

    name: str
    data: bytes
    role: Literal["data", "program", "note"] = "data"


def without_notes(files: Iterable[ControlFile]) -> tuple[ControlFile, ...]:
    return tuple(file for file in files if file.role != "note")
