"""What a reference holds of texts, tables and refusals: plain data."""

import difflib
import json
import re
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepdiag.base.errors import StepdiagError
from stepdiag.exporters.export.written import REPORT
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.tables import Table
from testkit.references import plain

_CODE_OR_FIGURE = re.compile(
    r"^ +(?:error|warning|info) "
    r"+([a-z.-]+):|(?<![\w.])([+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?)(?![\w.]*[A-Za-z])"
)
"""The code of a remark, or a number that belongs to no name."""


def lines(data: bytes) -> list[str]:
    """Return bytes as lines; a carriage return stays in its line."""
    return data.decode("latin-1").split("\n")


def files(some: Iterable[ControlFile]) -> dict[str, list[str]]:
    """Return files as lines by name."""
    return {f"{file.name} ({file.role})": lines(file.data) for file in some}


def written(folder: Path) -> dict[str, list[str]]:
    """Return the files of a folder as lines by name, without their hashes; of the report its codes
    and figures."""
    paths = (path for path in sorted(folder.iterdir()) if path.name != "SHA256SUMS")
    return {
        path.name: figures(lines(path.read_bytes()))
        if path.name == REPORT
        else lines(path.read_bytes())
        for path in paths
    }


def figures(text: Iterable[str]) -> list[str]:
    """Return of every line that a person reads its code and its figures; a line without both is
    left out."""
    found = (
        " ".join(each for pair in _CODE_OR_FIGURE.findall(line) for each in pair if each)
        for line in text
    )
    return [line for line in found if line]


def table(one: Table) -> dict[str, Any]:
    """Return all of a table."""
    found: dict[str, Any] = {
        "label": str(one.label),
        "at": one.position_mm.tolist(),
        "um": one.value_um.tolist(),
        "unit": one.quantum_um,
        "law": [one.law.sense, one.law.data, one.law.between, one.law.ends],
        "reference": one.reference_mm,
        "direction": one.direction,
        "offset": one.offset_um,
    }
    if one.multiplier is not None:
        times = one.multiplier
        found["times"] = [
            times.axis,
            times.position_mm.tolist(),
            times.value.tolist(),
            times.ends,
        ]
    return found


def attempted(act: Callable[[], Any]) -> Any:
    """Return what an act gives, or its refusal: its kind and the whole message."""
    try:
        return act()
    except StepdiagError as refusal:
        code = getattr(refusal, "code", "")
        return {
            "refused": f"{type(refusal).__name__}{f' [{code}]' if code else ''}: "
            f"{plain(refusal.message)}"
        }


def in_folder(act: Callable[[Path], Any]) -> Any:
    """Return what an act gives that is handed an empty folder; the folder's name does not stand in
    the refusal."""
    with tempfile.TemporaryDirectory() as name:
        found = attempted(lambda: act(Path(name)))
        if isinstance(found, dict) and "refused" in found:
            found["refused"] = found["refused"].replace(name, "FOLDER")
        return found


def beside(text: Sequence[str], other: Sequence[str], name: str) -> list[str]:
    """Return lines, runs of those that stand in the ``other`` text called ``name`` by their numbers
    there: all of a text, said shortly."""
    matcher = difflib.SequenceMatcher(a=other, b=text, autojunk=False)
    found = [f"<> {name}"]
    for what, low, high, begin, end in matcher.get_opcodes():
        found += (
            [f"<{low + 1}-{high}>"] if what == "equal" and high - low > 1 else text[begin:end]
        )
    return found


def shortened(cases: Mapping[str, Any]) -> dict[str, Any]:
    """Return cases with the files of all but the first that has one of a name said beside that
    one."""
    first: dict[str, tuple[str, list[str]]] = {}
    found: dict[str, Any] = {}
    for case, made in cases.items():
        held = made.get("files") if isinstance(made, dict) else None
        if held is None:
            found[case] = made
            continue
        texts: dict[str, list[str]] = {}
        for name, text in held.items():
            key = name.replace("_UNTESTED_SIGN", "")
            near = key if key in first else key.replace("_RESTORE", "")
            texts[name] = (
                beside(text, first[near][1], first[near][0]) if near in first else text
            )
            first.setdefault(key, (f"{name}, {case}", text))
        found[case] = {**made, "files": texts}
    return found


def grouped(outcomes: Mapping[str, Any]) -> dict[str, Any]:
    """Return outcomes by what they are, each with all that led to it; refusals by their text."""
    found: dict[str, list[str]] = {}
    for what, outcome in outcomes.items():
        refused = isinstance(outcome, dict) and list(outcome) == ["refused"]
        found.setdefault(
            outcome["refused"]
            if refused
            else json.dumps(rounded(outcome), ensure_ascii=False),
            [],
        ).append(what)
    return {outcome: what if len(what) > 1 else what[0] for outcome, what in found.items()}


def rounded(value: Any) -> Any:
    """Return plain data with its numbers to few digits: they stand in a text, where no tolerance
    is."""
    if isinstance(value, float):
        return float(f"{value:.6g}") + 0.0
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    return [rounded(item) for item in value] if isinstance(value, list | tuple) else value
