"""The rows of the table: a figure, its floor or peer in the same run, their ratio, and what was
asked for."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """One line; texts as they are to be read. ``met`` is None where nothing was asked for."""

    what: str
    figure: str
    beside: str = ""
    ratio: str = ""
    goal: str = ""
    met: bool | None = None


HEAD = ("what", "figure", "floor or peer, same run", "ratio", "goal", "met")


def render(rows: Sequence[Row]) -> str:
    """Return the table in Markdown, columns aligned."""
    verdict = {True: "yes", False: "NO", None: ""}
    cells = [
        HEAD,
        *(
            (row.what, row.figure, row.beside, row.ratio, row.goal, verdict[row.met])
            for row in rows
        ),
    ]
    widths = [max(len(line[column]) for line in cells) for column in range(len(HEAD))]
    lines = [
        "| "
        + " | ".join(text.ljust(width) for text, width in zip(line, widths, strict=True))
        + " |"
        for line in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)
