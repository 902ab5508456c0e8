"""Files that are made to cost as much as they can, and what going through a door costs."""

import os
import resource
from collections.abc import Callable, Mapping
from pathlib import Path

from testkit.hostile.door import Door

EVERY = "STEPDIAG_FUZZ_EXAMPLES" in os.environ
"""Whether all is tried that can be, by ``make explore``."""
CPU_S = 10
MEMORY_BYTES = 500_000_000
"""Beyond what the bytes justify (issue 14, item 5)."""
SIZE = 400_000
ENDED = {0, 2, 3, 5}


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
    half = (
        text.find(" = ", len(text) // 2) + 3
        if " = " in text[len(text) // 2 :]
        else text.find(",", len(text) // 2) + 1
    )
    return text[:half] + more + text[half:]


GROWN: Mapping[str, Callable[[str], str]] = {
    each.__name__: each
    for each in (
        longest_line,
        deepest,
        most_lines,
        shortest_lines,
        most_columns,
        most_quotes,
        most_blanks,
        most_remarks,
    )
}


def cost_of(door: Door, folder: Path) -> str:
    """Return what went wrong, empty where nothing did: the command runs in a copy of this process,
    which ends where it costs too much."""
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
    return (
        ""
        if os.waitstatus_to_exitcode(status) in ENDED
        else f"exit code {os.waitstatus_to_exitcode(status)}"
    )


def _within_limits(door: Door, folder: Path) -> int:
    now = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (now + MEMORY_BYTES, now + MEMORY_BYTES))
    spent = resource.getrusage(resource.RUSAGE_SELF)
    resource.setrlimit(
        resource.RLIMIT_CPU, (int(spent.ru_utime + spent.ru_stime + CPU_S) + 1,) * 2
    )
    return door.go_through(folder).code
