"""The verdicts on a table, in a word for programs and a sentence for people."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from stepdiag.exporters.tables.tables import Table

Code = Literal[
    "right", "empty", "kept", "unidentified", "sign-turned", "axes-swapped", "input-output-swapped", "wrong-measuring-system", "scaled",
    "beside-volume", "unlike",
]  # fmt: skip
HARMLESS: frozenset[Code] = frozenset({"right", "empty", "kept", "unidentified"})
"""Verdicts that do not stop anybody from loading a file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """What one table is, in a word for programs and a sentence; ``factor`` is its size against the right one where that is told."""

    table: Table
    code: Code
    text: str
    factor: float | None = None

    @property
    def harmless(self) -> bool:
        """Return whether the table may be loaded as far as this goes."""
        return self.code in HARMLESS

    def as_json(self) -> dict[str, object]:
        """Return the entry of ``verify --json``."""
        return {
            "function": self.table.name,
            "kind": self.table.kind,
            "place": dict(self.table.place),
            "law": self.table.law.describe(),
            "verdict": self.code,
            "factor": None if self.factor is None else round(self.factor, 4),
            "text": self.text,
        }


def worst(judgements: Iterable[Judgement]) -> Iterator[Judgement]:
    """Yield the judgements for which a file must not be loaded."""
    return (each for each in judgements if not each.harmless)
