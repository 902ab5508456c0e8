"""``python -m benchmarks.shops [--shops N] [--first K] [--cause WORDS]``: surveys with one wrong
statement, counted; with ``--clean`` surveys at which nothing is wrong.

Each shop (`testkit.exact.shops`) is a drawn machine with a cause: what the survey file states and
is not so. It is recorded, solved and exported in seconds of virtual time. Counted are: surveys
whose files are right; causes that are named by the line of the survey file to change, and after how
many stops; findings of a shop; wrong tables that would reach the control; and dead ends: neither
right nor named.

``--clean`` draws shops without a cause: quiet ones, ones with turbulent air before an instrument of
50 samples a second, and ones whose machine has scales up to 200 um/m. Counted are surveys with a
doubt, and wrong tables.
"""

import argparse
import statistics
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SHOPS = 108
LOUD_ANYWAY = frozenset({"signals-absent", "no-signals"})
"""Findings of the survey file alone."""
LEFT = 0.5
"""A survey is right where its files leave less than this share of the volume's error, and wrong
where they leave more."""


@dataclass(kw_only=True)
class Count:
    """What was counted of one cause."""

    shops: int = 0
    right: int = 0
    named: int = 0
    stops: list[int] = field(default_factory=list)
    findings: list[int] = field(default_factory=list)
    wrong: int = 0
    dead: list[int] = field(default_factory=list)
    false: list[int] = field(default_factory=list)
    """Shops at which a line was named that is not the wrong one."""


def named_after(found: Any) -> int | None:
    """Return after how many stops the right line of the survey file was named; None where it never
    was."""
    lines = [
        (stops, line)
        for stops, line in _lines(found)
        if found.shop.line and line.startswith(found.shop.line)
    ]
    return lines[0][0] if lines else None


def _lines(found: Any) -> list[tuple[int, str]]:
    """Return the lines that findings name, each with the number of stops before it: those of the
    result come after the last stop."""
    solved = [
        (found.stops, line) for line in (found.files.lines if found.files is not None else ())
    ]
    found_lines = [
        (stops, str(each.message.arguments["line"]))
        for stops, each in zip(found.after, found.findings, strict=True)
        if each.message is not None and "line" in each.message.arguments
    ]
    return found_lines + solved


def judge(found: Any, count: Count) -> None:
    """Count a shop."""
    count.shops += 1
    files, stops = found.files, named_after(found)
    left = (
        None if files is None or files.after_um is None else files.after_um / files.before_um
    )
    right = left is not None and left <= LEFT
    count.right += right
    count.wrong += left is not None and left > LEFT
    count.findings.append(
        sum(
            each.severity != "info" and each.code != "signals-absent"
            for each in found.findings
        )
    )
    if stops is not None:
        count.named += 1
        count.stops.append(stops)
    elif not right and not found.shop.faults:
        count.dead.append(found.shop.seed)
    if any(
        not found.shop.line or not line.startswith(found.shop.line)
        for _, line in _lines(found)
    ):
        count.false.append(found.shop.seed)


def counted(seeds: Sequence[int], cause: str = "") -> dict[str, Count]:
    """Return the counts by cause."""
    from testkit.exact.shops import draw, surveyed

    table: dict[str, Count] = {}
    for seed in seeds:
        shop = draw(seed)
        if cause in shop.cause:
            with tempfile.TemporaryDirectory() as name:
                judge(surveyed(shop, Path(name)), table.setdefault(shop.cause, Count()))
    return table


def print_clean(seeds: Sequence[int], cause: str = "") -> None:
    """Print for each kind of clean surveys which have a doubt, and which give wrong files."""
    from testkit.exact.shops import CLEAN, draw_clean, surveyed

    print("| clean surveys | number | doubtful | codes | wrong files |")
    print("|---|---|---|---|---|")
    for kind in [kind for kind in CLEAN if cause in kind]:
        count, codes = Count(), Counter[str]()
        doubtful = []
        for seed in seeds:
            with tempfile.TemporaryDirectory() as name:
                found = surveyed(draw_clean(seed, kind), Path(name))
            judge(found, count)
            doubts = [
                each.code
                for each in found.findings
                if each.severity != "info" and each.code not in LOUD_ANYWAY
            ]
            files = found.files
            if files is None or files.after_um is None:
                doubts += sorted(files.codes - LOUD_ANYWAY) if files is not None else ["open"]
                doubts = doubts or ["no files"]
            codes.update(set(doubts))
            doubtful += [seed] if doubts else []
        print(
            f"| {kind} | {count.shops} | {len(doubtful)} {doubtful or ''} | {dict(codes)} "
            f"| {count.wrong} |",
            flush=True,
        )


def print_table(table: dict[str, Count]) -> None:
    """Print the counts."""
    print(
        "| cause | shops | files right | named | stops until the name | findings a shop | wrong "
        "files | dead ends | another line named |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for cause, each in table.items():
        stops = (
            f"{statistics.median(each.stops):g}, most {max(each.stops)}"
            if each.stops
            else "-"
        )
        print(
            f"| {cause} | {each.shops} | {each.right} | {each.named} | {stops} | "
            f"{statistics.median(each.findings):g} "
            f"| {each.wrong} | {len(each.dead)} {each.dead or ''} | {len(each.false)} "
            f"{each.false or ''} |"
        )
    every = list(table.values())
    taken = [stop for each in every for stop in each.stops]
    print(
        f"\n{sum(each.shops for each in every)} shops: "
        f"{sum(each.shops - len(each.dead) for each in every)} right or named, median "
        f"{statistics.median(taken) if taken else '-'} stops, "
        f"{sum(each.wrong for each in every)} wrong to the file, "
        f"{sum(len(each.dead) for each in every)} dead ends, "
        f"{sum(len(each.false) for each in every)} named wrongly"
    )


def main() -> None:
    """Draw the shops and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shops", type=int, default=SHOPS)
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        help="number of the first shop: others are other shops",
    )
    parser.add_argument("--cause", default="", help="only causes that contain this")
    parser.add_argument(
        "--clean", action="store_true", help="surveys at which nothing is wrong"
    )
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.shops)
    if options.clean:
        print_clean(seeds, options.cause)
    else:
        print_table(counted(seeds, options.cause))


if __name__ == "__main__":
    main()
