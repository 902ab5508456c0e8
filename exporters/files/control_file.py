"""A file of an export: its name, its bytes and its purpose."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlFile:
    """A file for the control: plain name, exact bytes, and purpose.

    ``data`` is a table for the control (read back by ``parse``), ``program`` a part program that
    loads it, ``note`` text for people.
    """

    name: str
    data: bytes
    role: Literal["data", "program", "note"] = "data"


def without_notes(files: Iterable[ControlFile]) -> tuple[ControlFile, ...]:
    """Return the files that are for the control, in their order."""
    return tuple(file for file in files if file.role != "note")
