"""What a foreign file may cost: every file door, with a file of hundreds of kilobytes that was made to cost as much as it can."""

import os
import re
import resource
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from testkit.hostile.costly_logs import COSTLY
from testkit.hostile.door import LOG, MADE, Door
from testkit.hostile.doors import doors

CPU_S = 10
MEMORY_BYTES = 500_000_000
"""Beyond what the bytes justify (issue 14, item 5)."""
SIZE = 400_000
ENDED = {0, 2, 3, 5}
DOORS = {
    name: door for name, door in doors().items() if not re.fullmatch(r"(export|signtest|verify) (?!siemens)\w+ (result|profile|set)", name)
}
"""One of those that read the same with the same code; the tables of each control have readers of their own."""


def longest_line(text: str) -> str:
    """One word of the file is all that there is room for."""
    return _in_the_middle(text, "9" * SIZE)


def deepest(text: str) -> str:
    """A thing in a thing in a thing."""
    return _in_the_middle(text, "[" * (SIZE // 2) + "{" * (SIZE // 2))


def most_lines(text: str) -> str:
    """The second half of the file again and again."""
    lines = text.splitlines(keepends=True)
    again = "".join(lines[len(lines) // 2 :])
    return text + again * (SIZE // len(again))


def shortest_lines(text: str) -> str:
    """As many lines as there is room for."""
    return text + "x\n" * (SIZE // 2)


def most_columns(text: str) -> str:
    """A line of nothing but separators."""
    return text + ",;=" * (SIZE // 3) + "\n"


def most_quotes(text: str) -> str:
    """Each could be where a text begins."""
    return _in_the_middle(text, '"' + '\\"' * (SIZE // 2))


def most_blanks(text: str) -> str:
    """A line that goes on after a long nothing."""
    return _in_the_middle(text, "1" + " " * SIZE + "1")


def most_remarks(text: str) -> str:
    """Remarks that nobody closes."""
    return _in_the_middle(text, "/* (* ( " * (SIZE // 8))


def _in_the_middle(text: str, more: str) -> str:
    half = text.find(" = ", len(text) // 2) + 3 if " = " in text[len(text) // 2 :] else text.find(",", len(text) // 2) + 1
    return text[:half] + more + text[half:]


GROWN: Mapping[str, Callable[[str], str]] = {
    each.__name__: each
    for each in (longest_line, deepest, most_lines, shortest_lines, most_columns, most_quotes, most_blanks, most_remarks)
}


READERS = {
    door.command: replace(door, files={place: text for place, text in door.files.items() if place not in MADE})
    for door in DOORS.values()
    if door.command[-1] == LOG or LOG in door.bytes_beside or "contents" in door.files
}
"""Every command that reads a log, with what it is given besides."""
EVERY = "STEPDIAG_FUZZ_EXAMPLES" in os.environ
LOG_SIZE = 400_000 if EVERY else 40_000
LOG_DOORS = [
    (made, " ".join(command)) for turn, made in enumerate(COSTLY) for at, command in enumerate(READERS) if EVERY or at % len(COSTLY) == turn
]
DECODE = next(" ".join(command) for command in READERS if command[0] == "decode")
LOG_DOORS += [each for each in [("most_samples", DECODE)] if each not in LOG_DOORS]
"""Every log with every command that reads one by ``make explore``, each once in every run; and always 1.2 million lines to `decode`."""


def grown_for(name: str) -> list[str]:
    """Return the ways in which the file of a door grows: one by turns in every run, all of them with ``make explore``."""
    kinds, turn = list(GROWN), list(DOORS).index(name)
    return kinds if EVERY else [kinds[turn % len(kinds)]]


@pytest.mark.parametrize("name", DOORS)
def test_a_file_costs_no_more_than_its_bytes_justify(name: str, tmp_path: Path) -> None:
    door = DOORS[name]
    told = {kind: cost_of(door.with_text(GROWN[kind](door.files[door.wrong])), tmp_path / kind) for kind in grown_for(name)}
    assert not [f"{kind}: {how}" for kind, how in told.items() if how]


@pytest.mark.parametrize(("made", "command"), LOG_DOORS)
def test_a_log_costs_no_more_than_its_bytes_justify(made: str, command: str, tmp_path: Path) -> None:
    """Right checksums and right messages, a thousand bytes unpacked for each that is read: ranges, events, samples, texts."""
    log = COSTLY[made](LOG_SIZE)
    assert not cost_of(replace(READERS[tuple(command.split())], bytes_beside={LOG: log}), tmp_path / "log")


def cost_of(door: Door, folder: Path) -> str:
    """Return what went wrong, empty where nothing did: the command runs in a copy of this process, which ends where it costs too much."""
    folder.mkdir()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _within_limits(door, folder)
        finally:
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    if os.WIFSIGNALED(status):
        return f"ended by signal {os.WTERMSIG(status)} after {used.ru_utime + used.ru_stime:.1f} s"
    return "" if os.waitstatus_to_exitcode(status) in ENDED else f"exit code {os.waitstatus_to_exitcode(status)}"


def _within_limits(door: Door, folder: Path) -> int:
    now = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (now + MEMORY_BYTES, now + MEMORY_BYTES))
    spent = resource.getrusage(resource.RUSAGE_SELF)
    resource.setrlimit(resource.RLIMIT_CPU, (int(spent.ru_utime + spent.ru_stime + CPU_S) + 1,) * 2)
    return door.go_through(folder).code
