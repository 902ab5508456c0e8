"""``python tests/fuzz/by_turns.py MINUTES [FINDINGS]``: every file door of the command line, by
turns of equal computing.

The next turn is always of the door that has computed least, so that on a computer with other work
an hour still reaches all of them. What was found is printed and appended to FINDINGS
(build/fuzz/found.jsonl) with the door and the seed that show it again.
"""

import json
import os
import random
import resource
import shutil
import signal
import statistics
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # as the program does, and before numpy is loaded
sys.path.insert(0, str(Path(__file__).parents[1] / "lib"))

from testkit.hostile.door import Door, how_it_broke
from testkit.hostile.doors import doors

CPU_S = 30.0
"""For one command: three times what a file of hundreds of kilobytes may cost
(tests/stepdiag/cli/test_cost_of_doors.py)."""
MEMORY_BYTES = 2_000_000_000
CHANGES = (1, 1, 1, 1, 2, 4)
"""Fields that are wrong at once: mostly one, since the second is seldom reached."""


@dataclass
class Turn:
    """What one door has had so far."""

    door: Door
    commands: int = 0
    cpu_s: float = 0.0


class TooLongError(Exception):
    """One command computed longer than `CPU_S`."""


def main() -> int:
    """Go round until the time is up; 1 where anything was found."""
    minutes = float(sys.argv[1])
    findings = Path(sys.argv[2] if len(sys.argv) > 2 else "build/fuzz/found.jsonl")
    findings.parent.mkdir(parents=True, exist_ok=True)
    _limit()
    turns = {name: Turn(door) for name, door in doors().items()}
    found = 0
    for name in by_turns(turns, minutes * 60):
        seed = random.SystemRandom().getrandbits(48)
        how = one_turn(turns[name], seed)
        if how:
            found += 1
            line = json.dumps({"door": name, "seed": seed, "how": how})
            print(line, flush=True)
            with findings.open("a", encoding="utf-8") as out:
                out.write(line + "\n")
    print(told(turns, found))
    return 1 if found else 0


def by_turns(turns: dict[str, Turn], seconds: float) -> Iterator[str]:
    """Yield the door that has computed least, until the clock has gone on by so much and every door
    had a turn."""
    end = time.monotonic() + seconds
    said = time.monotonic()
    while time.monotonic() < end or not all(turn.commands for turn in turns.values()):
        yield min(turns, key=lambda name: turns[name].cpu_s)
        if time.monotonic() > said + 300:
            said = time.monotonic()
            print(told(turns, None), flush=True)


def one_turn(turn: Turn, seed: int) -> str:
    """Change the door's file as the seed says and go through; return what broke, empty where
    nothing did."""
    dice = random.Random(seed)
    begun = time.process_time()
    folder = Path(tempfile.mkdtemp(prefix="turn-"))
    try:
        with at_most(CPU_S):
            return how_it_broke(turn.door.with_text(changed(turn.door, dice)), folder)
    except Exception:  # noqa: BLE001 - whatever a command lets through is what is looked for
        return traceback.format_exc()[-4000:]
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        turn.commands += 1
        turn.cpu_s += time.process_time() - begun


def changed(door: Door, dice: random.Random) -> str:
    """Return the door's file with one field wrong, seldom more; a text that cannot be changed once
    more is taken as it is."""
    text = door.files[door.wrong]
    for _ in range(dice.choice(CHANGES)):
        try:
            text = door.change(text, dice)
        except (
            ValueError,
            IndexError,
        ):  # the first change left nothing that still reads as such a file
            break
    return text


@contextmanager
def at_most(cpu_s: float) -> Iterator[None]:
    """Raise `TooLongError` in the code below where it computes longer."""

    def stop(*_: object) -> None:
        raise TooLongError(f"more than {cpu_s} s of computing")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, cpu_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def told(turns: dict[str, Turn], found: int | None) -> str:
    """Return how far the doors have come."""
    commands = [turn.commands for turn in turns.values()]
    cpu_s = [turn.cpu_s for turn in turns.values()]
    reached = sum(count > 0 for count in commands)
    few = min(turns, key=lambda name: turns[name].commands)
    end = "" if found is None else f"; found: {found}"
    return (
        f"{reached} of {len(turns)} doors, {sum(commands)} commands ({min(commands)} in {few!r}, "
        f"median {statistics.median(commands):.0f}, "
        f"{max(commands)}), {sum(cpu_s) / 60:.1f} minutes of computing ({min(cpu_s):.0f} to "
        f"{max(cpu_s):.0f} s a door){end}"
    )


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
    warnings.simplefilter("error")


if __name__ == "__main__":
    raise SystemExit(main())
