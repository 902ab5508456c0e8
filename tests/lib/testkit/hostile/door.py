"""A file door of the command line: a command, the files that it is given, and the one of them that
somebody else wrote."""

import random
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, field, replace
from pathlib import Path

from stepdiag.base.errors import StepdiagError
from stepdiag.terminal.exits import EXIT_CODES
from testkit.cli import Told, stepdiag
from testkit.hostile.foreign_logs import log_of, with_survey

LOG = "0001.mcap"
MADE: dict[str, Callable[[str], bytes]] = {
    "survey": with_survey,
    "contents": lambda text: log_of(text.encode()),
    "survey of a cut log": lambda text: with_survey(text)[:-300],
}
"""What becomes of a text that stands for part of a log, under right checksums."""

LONGEST_SAID = 20_000
"""Characters of a refusal."""

Change = Callable[[str, random.Random], str]


@dataclass(frozen=True)
class Door:
    """A command, the files it is given as text, the one of them that is wrong, and how.
    ``bytes_beside`` are right and no text.

    A name of `MADE` stands for a log that is made of the text. ``reads`` is what a command that
    does not end by itself, or asks a person, does with its files; it is called in their folder in
    place of the command.
    """

    command: tuple[str, ...]
    files: dict[str, str]
    wrong: str
    change: Change
    bytes_beside: dict[str, bytes] = field(default_factory=dict)
    reads: Callable[[], object] | None = None

    def with_text(self, text: str) -> "Door":
        """Return the same door with this text in place of the file that is wrong."""
        return replace(self, files={**self.files, self.wrong: text})

    def place(self, folder: Path) -> None:
        """Write the files."""
        folder.mkdir(exist_ok=True)
        for name, text in self.files.items():
            if name in MADE:
                (folder / LOG).write_bytes(MADE[name](text))
                continue
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8", newline="")
        for name, data in self.bytes_beside.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)

    def go_through(self, folder: Path) -> Told:
        """Run the command where its files are."""
        self.place(folder)
        return self.go_through_placed(folder)

    def go_through_placed(self, folder: Path) -> Told:
        """Run the command in a folder that has its files."""
        with chdir(folder):
            return stepdiag(*self.command) if self.reads is None else _told(self.reads)


def _told(reads: Callable[[], object]) -> Told:
    try:
        return Told(0, str(reads()), "")
    except StepdiagError as refusal:
        return Told(
            next(code for cause, code in EXIT_CODES.items() if isinstance(refusal, cause)),
            "",
            str(refusal),
        )


def how_it_broke(door: Door, folder: Path) -> str:
    """Go through a door; return where the command did not end as the contract says, empty where it
    did."""
    told = door.go_through(folder)
    ours = {Path(place).name for place in door.files}
    left = [
        path.name
        for path in folder.rglob("*")
        if path.name.startswith(".") and path.is_file() and path.name not in ours
    ]
    wrong = {
        f"exit code {told.code}": told.code not in {0, 2, 3, 5},
        "a refusal without a reason": told.code != 0 and not told.refusal and not told.out,
        f"a refusal of {len(told.refusal)} characters": len(told.refusal) >= LONGEST_SAID,
        f"half written: {left}": bool(left),
    }
    return "; ".join(how for how, is_so in wrong.items() if is_so)
