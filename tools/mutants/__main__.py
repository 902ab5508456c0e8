"""How sharp the tests are: small changes of the program, each before the tests that reach it. What
no test notices, survives.

    python tools/mutants                     every change (hours: at night)
    python tools/mutants --count 400 --seed 10  a sample, spread over the files by their share; the
    same for the same seed
    ... --keep                               the map of who reaches what and what was killed stay;
    the survivors are asked again

Everything stands in .mutants/: reach-FLOOR-ROOM.json of the tests, results.jsonl. survivors.md has
a reason for each survivor that stays. Exits 1 where less than 92 % is killed.
"""

import argparse
import difflib
import importlib
import json
import os
import shutil
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from mutation import Mutation, draw, mutations
from reach import QUICK, Map, record
from reasons import known
from trial import Question, ask, question

ROOT = Path(__file__).resolve().parent.parent.parent
ROOMS = ["stepdiag/base", "solver", "exporters", "daq/capture", "daq/formats"]
# who is asked: every unit test but those of the links, which wait for ports
TESTS = ["tests/solver/*", "tests/exporters/*", "tests/daq/*", "tests/stepdiag/*"]
LEFT_OUT = {"links"}
FLOOR = 0.92
WORK = ROOT / ".mutants"


def files(words: list[str]) -> list[str]:
    """Return the files whose sharpness is asked, those that begin with one of the words where there
    are any."""
    found = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    names = [str(path.relative_to(ROOT)) for path in found]
    return [
        name for name in names if not words or any(name.startswith(word) for word in words)
    ]


def warm() -> None:
    """Import what every child needs before they are forked, but nothing of what is changed: pytest
    with its plugins, and libraries."""
    for name in (
        "hypothesis.strategies",
        "numpy.testing",
        "msgspec",
        "re2",
        "tomllib",
        "anyio",
        "pdb",
    ):
        importlib.import_module(name)
    pytest.main(["--version", *QUICK])


def folders() -> list[str]:
    """Return the folders of tests that are asked."""
    found = [
        path
        for pattern in TESTS
        for path in sorted(ROOT.glob(pattern))
        if path.is_dir() and any(path.rglob("test_*.py"))
    ]
    return [str(path.relative_to(ROOT)) for path in found if path.name not in LEFT_OUT]


def reach(keep: bool, jobs: int) -> Map:
    """Return who reaches what, from children that run the tests, a folder each."""
    children, failed, targets = {}, [], []

    def ended() -> None:
        child, status = os.wait()
        folder = children.pop(child)
        if status:
            failed.append(folder)

    for folder in folders():
        targets.append(WORK / f"reach-{'-'.join(Path(folder).parts[1:])}.json")
        if keep and targets[-1].exists():
            continue
        if not (child := os.fork()):
            os._exit(
                record(ROOT, [folder], [str(ROOT / room) for room in ROOMS], targets[-1])
            )
        children[child] = folder
        if len(children) >= jobs:
            ended()
    while children:
        ended()
    if failed:
        raise SystemExit(
            f"{' and '.join(failed)} fail as they are: nothing can be said of changes"
        )
    return Map(targets)


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
    return {
        one["name"]: one["outcome"] for one in told if one["outcome"] in {"killed", "timeout"}
    }


def run(todo: list[Mutation], reached: Map, jobs: int) -> None:
    """Try each; every outcome is written as it comes."""
    questions = [question(ROOT, one, reached) for one in todo]
    with (WORK / "results.jsonl").open("a", encoding="utf-8") as results:

        def told(asked: Question, outcome: str, seconds: float) -> None:
            one = asked.mutation
            results.write(
                json.dumps(
                    {
                        **one._asdict(),
                        "outcome": outcome,
                        "seconds": round(seconds, 1),
                        "tests": len(asked.tests),
                    }
                )
                + "\n"
            )
            results.flush()
            print(
                f"{outcome} {one.path}:{one.line} {one.operator} {seconds:.1f} s", flush=True
            )

        for asked in questions:
            if not asked.tests:
                told(asked, "survived", 0.0)
        ask(ROOT, folders(), [asked for asked in questions if asked.tests], jobs, told)


def main() -> int:
    """Ask, and print the survivors and the share that was killed."""
    options = argparse.ArgumentParser(
        prog="tools/mutants",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_argument("paths", nargs="*", help="files or rooms, as solver/linear")
    options.add_argument("--count", type=int, default=0)
    options.add_argument("--seed", type=int, default=10)
    options.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options.add_argument("--keep", action="store_true")
    options.add_argument(
        "--list", action="store_true", help="print the changes that would be tried, and stop"
    )
    told = options.parse_args()
    if WORK.exists() and not told.keep and not told.list:
        shutil.rmtree(WORK)
    WORK.mkdir(exist_ok=True)
    groups = {path: list(mutations(ROOT, path)) for path in files(told.paths)}
    drawn = draw(groups, told.count, told.seed)
    print(
        f"{len(drawn)} of {sum(map(len, groups.values()))} changes in {len(groups)} files, seed "
        f"{told.seed}",
        flush=True,
    )
    if told.list:
        print("\n".join(f"{one.path}:{one.line} {one.operator}  {one.text}" for one in drawn))
        return 0
    outcomes = judged(told.keep)
    warm()
    reached = reach(told.keep, told.jobs)
    began = time.monotonic()
    run(
        sorted(
            (one for one in drawn if one.name not in outcomes),
            key=lambda one: one.rank(told.seed),
        ),
        reached,
        told.jobs,
    )
    outcomes = judged(keep=True)
    survivors, reasons = [one for one in drawn if one.name not in outcomes], known()
    for one in survivors:
        word = (
            "survived, with a reason"
            if (one.path, one.operator, one.text) in reasons
            else "SURVIVED"
        )
        print(f"{word}: {one.path}:{one.line} {one.operator}\n{difference(one)}")
    share = 1 - len(survivors) / len(drawn)
    told_s = time.monotonic() - began
    print(
        f"{len(drawn) - len(survivors)} of {len(drawn)} killed: {share:.1%}, at least "
        f"{FLOOR:.0%} wanted, in {told_s:.0f} s"
    )
    return int(share < FLOOR)


raise SystemExit(main())
