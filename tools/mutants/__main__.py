"""How sharp the tests are: small changes of the program, each before the tests that reach it. What no test notices, survives.

    python tools/mutants                     every change (hours: at night)
    python tools/mutants --count 400 --seed 10  a sample, spread over the files by their share; the same for the same seed
    ... --keep                               the map of who reaches what and what was killed stay; the survivors are asked again

Everything stands in .mutants/: reach-FLOOR-ROOM.json, results.jsonl, and the output of the last trial of each. docs/testing.md has a reason
for each survivor that stays. Exits 1 where less than 92 % is killed.
"""

import argparse
import difflib
import importlib
import json
import os
import shutil
import time
from pathlib import Path
from typing import TextIO

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from mutation import Mutation, draw, mutations
from reach import QUICK, Map, record
from trial import Question, ask, question

ROOT = Path(__file__).resolve().parent.parent.parent
ROOMS = {"solver": ["solver"], "exporters": ["exporters"], "daq": ["daq/capture", "daq/formats"]}
# who is asked: the tests of the same floor; of the recording the rooms around the seam
TESTS = {"solver": "tests/solver/*", "exporters": "tests/exporters/*", "daq": "tests/daq/[cfp]*"}
FLOOR = 0.92
WORK = ROOT / ".mutants"
PAGE = ROOT / "docs/testing.md"


def files(words: list[str]) -> list[str]:
    """Return the files whose sharpness is asked, those that begin with one of the words where there are any."""
    found = [path for rooms in ROOMS.values() for room in rooms for path in sorted((ROOT / room).rglob("*.py"))]
    names = [str(path.relative_to(ROOT)) for path in found]
    return [name for name in names if not words or any(name.startswith(word) for word in words)]


def warm() -> None:
    """Import what every child needs before they are forked, but nothing of what is changed: pytest with its plugins, and libraries."""
    for name in ("hypothesis.strategies", "numpy.testing", "msgspec", "re2", "tomllib", "anyio", "pdb"):
        importlib.import_module(name)
    pytest.main(["--version", *QUICK])


def reach(floors: list[str], keep: bool, jobs: int) -> dict[str, Map]:
    """Return who reaches what on each floor, from children that run its tests, a folder each."""
    maps: dict[str, list[Path]] = {floor: [] for floor in floors}
    children, failed = {}, []

    def ended() -> None:
        child, status = os.wait()
        folder = children.pop(child)
        if status:
            failed.append(folder)

    for floor in floors:
        for folder in sorted(path for path in ROOT.glob(TESTS[floor]) if path.is_dir() and any(path.glob("test_*.py"))):
            target = WORK / f"reach-{floor}-{folder.name}.json"
            maps[floor].append(target)
            if keep and target.exists():
                continue
            if not (child := os.fork()):
                os._exit(record(ROOT, [str(folder.relative_to(ROOT))], [str(ROOT / room) for room in ROOMS[floor]], target))
            children[child] = str(folder)
            if len(children) >= jobs:
                ended()
    while children:
        ended()
    if failed:
        raise SystemExit(f"{' and '.join(failed)} fail as they are: nothing can be said of changes")
    return {floor: Map(targets) for floor, targets in maps.items()}


def known() -> set[tuple[str, str, str]]:
    """Return the survivors that the page has a reason for: file, operator, line."""
    rows = [line.replace(r"\|", "\0").split("|") for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    told = [[cell.strip().strip("`").replace("\0", "|") for cell in row[1:4]] for row in rows]
    return {(cells[0], cells[1], cells[2]) for cells in told}


def difference(mutation: Mutation) -> str:
    """Return the changed lines, before and after."""
    old = (ROOT / mutation.path).read_text(encoding="utf-8").splitlines()
    told = difflib.unified_diff(old, mutation.apply(ROOT).splitlines(), lineterm="", n=0)
    return "\n".join(f"    {line}" for line in list(told)[3:])


def judged(keep: bool) -> dict[str, str]:
    """Return what earlier trials killed, by name."""
    record_file = WORK / "results.jsonl"
    if not keep or not record_file.exists():
        return {}
    told = [json.loads(line) for line in record_file.read_text(encoding="utf-8").splitlines()]
    return {one["name"]: one["outcome"] for one in told if one["outcome"] in {"killed", "timeout"}}


def run(todo: list[Mutation], maps: dict[str, Map], jobs: int) -> None:
    """Try each, floor by floor; every outcome is written as it comes."""
    for floor, reached in maps.items():
        questions = [question(ROOT, one, reached) for one in todo if one.path.startswith(f"{floor}/")]
        folders = [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob(TESTS[floor])) if path.is_dir()]
        with (WORK / "results.jsonl").open("a", encoding="utf-8") as results:

            def told(asked: Question, outcome: str, seconds: float, results: TextIO = results) -> None:
                one = asked.mutation
                results.write(
                    json.dumps({**one._asdict(), "outcome": outcome, "seconds": round(seconds, 1), "tests": len(asked.tests)}) + "\n"
                )
                results.flush()
                print(f"{outcome} {one.path}:{one.line} {one.operator} {seconds:.1f} s", flush=True)

            for asked in questions:
                if not asked.tests:
                    told(asked, "survived", 0.0)
            ask(ROOT, folders, [asked for asked in questions if asked.tests], jobs, told)


def main() -> int:
    """Ask, and print the survivors and the share that was killed."""
    options = argparse.ArgumentParser(prog="tools/mutants", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("paths", nargs="*", help="files or rooms, as solver/linear")
    options.add_argument("--count", type=int, default=0)
    options.add_argument("--seed", type=int, default=10)
    options.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options.add_argument("--keep", action="store_true")
    options.add_argument("--list", action="store_true", help="print the changes that would be tried, and stop")
    told = options.parse_args()
    if WORK.exists() and not told.keep and not told.list:
        shutil.rmtree(WORK)
    WORK.mkdir(exist_ok=True)
    groups = {path: list(mutations(ROOT, path)) for path in files(told.paths)}
    drawn = draw(groups, told.count, told.seed)
    print(f"{len(drawn)} of {sum(map(len, groups.values()))} changes in {len(groups)} files, seed {told.seed}", flush=True)
    if told.list:
        print("\n".join(f"{one.path}:{one.line} {one.operator}  {one.text}" for one in drawn))
        return 0
    outcomes = judged(told.keep)
    warm()
    floors = {one.path.partition("/")[0] for one in drawn}
    maps = reach(sorted(floors), told.keep, told.jobs)
    began = time.monotonic()
    run(sorted((one for one in drawn if one.name not in outcomes), key=lambda one: one.rank(told.seed)), maps, told.jobs)
    outcomes = judged(keep=True)
    survivors, reasons = [one for one in drawn if one.name not in outcomes], known()
    for one in survivors:
        word = "survived, with a reason" if (one.path, one.operator, one.text) in reasons else "SURVIVED"
        print(f"{word}: {one.path}:{one.line} {one.operator}\n{difference(one)}")
    share = 1 - len(survivors) / len(drawn)
    told_s = time.monotonic() - began
    print(f"{len(drawn) - len(survivors)} of {len(drawn)} killed: {share:.1%}, at least {FLOOR:.0%} wanted, in {told_s:.0f} s")
    return int(share < FLOOR)


raise SystemExit(main())
