"""The reference data of tests/data/reference/: what the program makes of recorded inputs (README.md
there).

    python tools/references            every case
    python tools/references solver     those of one floor; further words: names of cases

A recorded input stays; one that is not there yet is made. A module here is a floor and has
``CASES``: name -> (about, call, the function that makes the input); testkit.references.FLOOR has
the ``CALLS``. What is written differs only where the program does something else: say why in the
CHANGELOG.
"""

import importlib
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests" / "lib"))

from testkit.references import FOLDER, differences, plain, rendered  # noqa: E402


def write(floor: str, words: list[str]) -> None:
    """Write the cases of a floor, those named where some are, and say what became different."""
    cases = importlib.import_module(floor).CASES
    calls = importlib.import_module(f"testkit.references.{floor}").CALLS
    for name, (about, call, made) in cases.items():
        if words and name not in words:
            continue
        path = FOLDER / floor / f"{name}.json"
        before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        given = (
            before["input"]
            if before
            else json.loads(rendered({"input": plain(made())}))["input"]
        )
        output = json.loads(rendered({"output": plain(calls[call](given))}))["output"]
        if (
            before
            and before["call"] == call
            and not list(differences(before["output"], output))
        ):
            output = before["output"]  # rounding on another processor is no news
        path.parent.mkdir(parents=True, exist_ok=True)
        text = rendered({"about": about, "call": call, "input": given, "output": output})
        said = (
            "new"
            if not before
            else "as before"
            if text == path.read_text(encoding="utf-8")
            else "DIFFERENT"
        )
        path.write_text(text, encoding="utf-8")
        print(f"{floor}/{name}: {said}, {len(text) // 1000} kB")


def main(words: list[str]) -> None:
    """Write what the words name: a floor, and cases of it."""
    floors = sorted(
        path.stem
        for path in Path(__file__).parent.glob("*.py")
        if not path.stem.startswith("_")
    )
    for floor in [words[0]] if words else floors:
        write(floor, words[1:])


main(sys.argv[1:])
