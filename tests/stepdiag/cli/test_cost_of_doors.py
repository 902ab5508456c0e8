"""What a foreign file may cost: every file door, with a file of hundreds of kilobytes that was made
to cost as much as it can."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from testkit.hostile.cost import EVERY, GROWN, cost_of
from testkit.hostile.costly_logs import COSTLY
from testkit.hostile.door import LOG, MADE
from testkit.hostile.doors import doors

DOORS = {
    name: door
    for name, door in doors().items()
    if not re.fullmatch(r"(export|signtest|verify) (?!siemens)\w+ (result|profile|set)", name)
}
"""One of those that read the same with the same code; the tables of each control have readers of
their own."""


READERS = {
    door.command: replace(
        door, files={place: text for place, text in door.files.items() if place not in MADE}
    )
    for door in DOORS.values()
    if door.command[-1] == LOG or LOG in door.bytes_beside or "contents" in door.files
}
"""Every command that reads a log, with what it is given besides."""
LOG_SIZE = 400_000 if EVERY else 40_000
LOG_DOORS = [
    (made, " ".join(command))
    for turn, made in enumerate(COSTLY)
    for at, command in enumerate(READERS)
    if EVERY or at % len(COSTLY) == turn
]
DECODE = next(" ".join(command) for command in READERS if command[0] == "decode")
LOG_DOORS += [each for each in [("most_samples", DECODE)] if each not in LOG_DOORS]
"""Every log with every command that reads one by ``make explore``, each once in every run; and
always 1.2 million lines to `decode`."""


def grown_for(name: str) -> list[str]:
    """Return the ways in which the file of a door grows: one by turns in every run, all of them
    with ``make explore``."""
    kinds, turn = list(GROWN), list(DOORS).index(name)
    return kinds if EVERY else [kinds[turn % len(kinds)]]


@pytest.mark.parametrize("name", DOORS)
def test_a_file_costs_no_more_than_its_bytes_justify(name: str, tmp_path: Path) -> None:
    door = DOORS[name]
    told = {
        kind: cost_of(door.with_text(GROWN[kind](door.files[door.wrong])), tmp_path / kind)
        for kind in grown_for(name)
    }
    assert not [f"{kind}: {how}" for kind, how in told.items() if how]


@pytest.mark.parametrize(("made", "command"), LOG_DOORS)
def test_a_log_costs_no_more_than_its_bytes_justify(
    made: str, command: str, tmp_path: Path
) -> None:
    """Right checksums and right messages, a thousand bytes unpacked for each that is read: ranges,
    events, samples, texts."""
    log = COSTLY[made](LOG_SIZE)
    assert not cost_of(
        replace(READERS[tuple(command.split())], bytes_beside={LOG: log}), tmp_path / "log"
    )
