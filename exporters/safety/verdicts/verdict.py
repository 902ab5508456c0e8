"""The verdicts on a table: a word for programs and a sentence for people."""

from dataclasses import dataclass
from typing import Literal

from stepdiag.base.messages import Message
from stepdiag.exporters.tables.tables import Table

Code = Literal[
    "right",
    "empty",
    "kept",
    "unidentified",
    "missing",
    "sign-turned",
    "axes-swapped",
    "input-output-swapped",
    "wrong-measuring-system",
    "scaled",
    "beside-volume",
    "unlike",
]
HARMLESS: frozenset[Code] = frozenset({"right", "empty", "kept", "unidentified"})
"""Verdicts with which a file may be loaded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """The verdict on a table, or on a function without a table (``table`` is None).

    ``factor`` is the size of the table relative to the right table. ``rms_um`` and ``largest_um``
    are the difference from the right table in this size, along the axis; None without a
    comparison.
    """

    function: str
    table: Table | None
    code: Code
    words: Message
    factor: float | None = None
    rms_um: float | None = None
    largest_um: float | None = None

    @property
    def text(self) -> str:
        return str(self.words)

    @property
    def harmless(self) -> bool:
        return self.code in HARMLESS

    def as_json(self) -> dict[str, object]:
        table = self.table
        return {
            "function": self.function,
            "kind": None if table is None else table.kind,
            "place": {} if table is None else dict(table.place),
            "law": None if table is None else str(table.law.words),
            "verdict": self.code,
            "factor": None if self.factor is None else round(self.factor, 4),
            "rms_um": None if self.rms_um is None else round(self.rms_um, 3),
            "largest_um": None if self.largest_um is None else round(self.largest_um, 3),
            "text": self.text,
        }
