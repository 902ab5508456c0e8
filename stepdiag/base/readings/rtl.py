"""Reading and writing of Renishaw ``.rtl`` files (linear runs of a laser).

Renishaw does not publish the format. The known facts come from four independent public readers and
writers that agree (docs/lasers.md). The reader therefore accepts sections, keys and white space in
any order, and refuses a file unless each run contains every target once.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import DataError, UsageError
from stepdiag.base.messages import excerpt, message
from stepdiag.base.readings.readings import PassKey, Readings
from stepdiag.base.volume import Vector

MOST_TARGETS = 20_000
MOST_RUNS = 200
LARGEST_DEVIATION_UM = 1e5
"""Largest magnitude of a deviation: 100 mm. A larger number has another unit or is an angle."""
_SECTION = re.compile(r"\s*(?P<name>[A-Z][A-Z -]*)::\s*\Z", re.IGNORECASE)
_PAIR = re.compile(r"\s*(?P<key>[^:]{1,60}?)\s*:\s*(?P<value>.*?)\s*\Z")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?")
_OTHER = ("angular", "straightness", "squareness", "flatness", "rotary", "dynamic")
_A_LINE = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Rtl:
    """The content of a file: targets (k,) in mm, deviations (runs, k) in um. Odd runs go outward,
    even runs back.

    ``texts`` are the keys of the file in lower case with their values; of a repeated key the first
    value is used.
    """

    targets_mm: Vector
    deviations_um: Vector
    both_ways: bool = True
    texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def axis(self) -> str:
        """Return the axis named in the file (x, y, z); empty if the file names no axis."""
        named = (
            self.texts.get("axis", "")
            .strip()
            .lower()
            .removesuffix("-axis")
            .removesuffix(" axis")
            .strip()
        )
        return named if named in ("x", "y", "z") else ""


def parse_rtl(text: str, source: str) -> Rtl:
    """Return the content of a file. Raises DataError for a section or value that is missing,
    repeated or not a length."""
    sections = _sections(text, source)
    texts: dict[str, str] = {}
    for lines in sections.values():
        for line in lines:
            if found := _PAIR.match(line):
                texts.setdefault(found["key"].lower(), found["value"])
    _refuse_other_kinds(texts, source)
    targets = _targets(sections, texts, source)
    runs = _count(texts, "run-count", MOST_RUNS, source)
    deviations = np.full((runs, len(targets)), np.nan)
    for number, line in _deviation_lines(sections, source):
        where = f"{source}: deviation {number}"
        run, target, deviation = _deviation_row(line, where)
        if not (1 <= run <= runs and 1 <= target <= len(targets)):
            expected = message("runs-and-targets", runs=runs, targets=len(targets))
            raise DataError(
                where, expected=expected, found=message("run-target", run=run, target=target)
            )
        if not np.isnan(deviations[run - 1, target - 1]):
            raise DataError(
                where,
                expected=message("every-target-once-run"),
                found=message("run-target-again", run=run, target=target),
            )
        deviations[run - 1, target - 1] = deviation
    missing = np.argwhere(np.isnan(deviations))
    if len(missing):
        run, target = (int(each) + 1 for each in missing[0])
        raise DataError(
            source,
            expected=message("runs-targets", runs=runs, targets=len(targets)),
            found=message("no-deviation-run-at", run=run, target=target),
        )
    both_ways = _both_ways(texts, runs)
    return Rtl(targets_mm=targets, deviations_um=deviations, both_ways=both_ways, texts=texts)


def _sections(text: str, source: str) -> dict[str, list[str]]:
    sections: dict[str, list[str]] = {}
    name = ""
    for line in text.removeprefix("\ufeff").splitlines():
        found = _SECTION.match(line)
        if found is None:
            sections.setdefault(name, []).append(line)
            continue
        name = found["name"].upper().strip()
        if name in sections and name != "EOF":
            raise DataError(
                f"{source}: {name}", expected=message("every-section-once"), found="twice"
            )
        sections[name] = []
    for needed in ("TARGET DATA", "RUNS", "DEVIATIONS"):
        if needed not in sections:
            found_names = ", ".join(each for each in sections if each) or "none"
            raise DataError(
                source,
                expected=message("section-rtl-file", needed=needed),
                found=message("sections-of-file", found_names=found_names),
            )
    if "EOF" not in sections:
        raise DataError(
            source,
            expected=message("eof-at-end"),
            found=message("none"),
            remedy=message("file-was-cut-off"),
        )
    return sections


def _refuse_other_kinds(texts: Mapping[str, str], source: str) -> None:
    """Raise DataError for files of angles and other quantities: the public sources do not contain
    their units."""
    for key in ("file type", "filetype", "title", "measurement", "measurement type"):
        text = texts.get(key, "").lower()
        if key != "title" and any(word in text for word in _OTHER):
            remedy = message("straightness-angles-rtl-are")
            raise DataError(
                f"{source}: {key}",
                expected=message("lengths-linear-measurement"),
                found=repr(texts[key]),
                remedy=remedy,
            )


def _count(texts: Mapping[str, str], key: str, most: int, source: str) -> int:
    text = texts.get(key, "")
    if not text.isascii() or not text.isdecimal() or not 1 <= int(text[:9]) <= most:
        raise DataError(
            f"{source}: {key}",
            expected=message("whole-number-from-one", most=most),
            found=repr(text) if text else message("nothing"),
        )
    return int(text)


def _targets(
    sections: Mapping[str, list[str]], texts: Mapping[str, str], source: str
) -> Vector:
    count = _count(texts, "target-count", MOST_TARGETS, source)
    lines = sections["TARGET DATA"]
    begin = next(
        (
            number
            for number, line in enumerate(lines)
            if line.strip().lower().startswith("targets")
        ),
        None,
    )
    if begin is None:
        raise DataError(
            f"{source}: TARGET DATA", expected=message("line-targets"), found=message("none")
        )
    end = next(
        (number for number, line in enumerate(lines[begin + 1 :], begin + 1) if ":" in line),
        len(lines),
    )
    words = [
        word
        for line in (lines[begin].partition(":")[2], *lines[begin + 1 : end])
        for word in line.split()
    ]
    targets = [
        _bounded_number(word, f"{source}: target {number}")
        for number, word in enumerate(words, 1)
    ]
    if len(targets) != count or count < 2:
        raise DataError(
            f"{source}: Targets",
            expected=message("target-count-numbers-two", count=count),
            found=str(len(targets)),
        )
    found = np.array(targets)
    steps = np.diff(found)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise DataError(
            f"{source}: Targets",
            expected=message("targets-rise-fall-all"),
            found=message("other-ones"),
        )
    return found


def _deviation_lines(
    sections: Mapping[str, list[str]], source: str
) -> Iterator[tuple[int, str]]:
    number = 0
    for line in sections["DEVIATIONS"]:
        if not line.strip() or not re.match(r"\s*[-+0-9.]", line):
            continue
        number += 1
        if number > MOST_RUNS * MOST_TARGETS:
            raise DataError(source, expected=message("fewer-deviations"), found=str(number))
        yield number, line


def _deviation_row(line: str, where: str) -> tuple[int, int, float]:
    words = line.split()
    if len(words) != 3 or not (
        words[0].isdecimal()
        and words[1].isdecimal()
        and len(words[0]) < 9
        and len(words[1]) < 9
    ):
        raise DataError(
            where, expected=message("run-target-deviation"), found=repr(excerpt(line.strip()))
        )
    deviation = _bounded_number(words[2], where)
    if abs(deviation) > LARGEST_DEVIATION_UM:
        raise DataError(
            where,
            expected=message("deviation-um-below", largest_deviation_um=LARGEST_DEVIATION_UM),
            found=words[2],
        )
    return int(words[0]), int(words[1]), deviation


def _bounded_number(word: str, where: str) -> float:
    if not _NUMBER.fullmatch(word) or abs(float(word)) > LARGEST:
        raise DataError(
            where, expected=message("number-with-decimal-point"), found=repr(excerpt(word))
        )
    return float(word)


def _both_ways(texts: Mapping[str, str], runs: int) -> bool:
    """Return whether even runs go back. The flags of the file decide (0 1 2 0: one way only);
    without flags, a file with two runs has one in each direction."""
    flags = texts.get("flags", "").split()
    return flags[:4] != ["0", "1", "2", "0"] if len(flags) >= 4 else runs > 1


def rtl_readings(
    file: Rtl, setup: str, at_mm: Sequence[float], source: str
) -> tuple[list[tuple[int, int, tuple[float, ...], float]], str]:
    """Return the rows (pass, stop, position, reading in mm) of a linear run, and the name of its
    setup.

    ``setup`` (``linear-x``) is required if the file names no axis. ``at_mm`` (3,) is a point of the
    measured line; its coordinate along the axis has no effect. Raises UsageError for an unknown
    axis or an axis that differs from the file.
    """
    axis = setup.removeprefix("linear-") if setup else file.axis
    if not axis or (file.axis and file.axis != axis):
        found = message("spot-axis", number=repr(file.texts.get("axis", "")))
        raise UsageError(
            source,
            expected=message("axis-x-y-z"),
            found=found,
            remedy=message("name-linear-x-file"),
        )
    index = "xyz".index(axis)
    last = len(file.targets_mm) - 1
    rows = []
    for run, deviations in enumerate(file.deviations_um):
        backward = file.both_ways and run % 2 == 1
        number = run + 1 if file.both_ways else 2 * run + 1
        order = range(last, -1, -1) if backward else range(last + 1)
        first = file.targets_mm[order[0]] + deviations[order[0]] * 1e-3
        for stop, target in enumerate(order):
            position = [float(each) for each in at_mm]
            position[index] = float(file.targets_mm[target])
            rows.append(
                (
                    number,
                    stop,
                    tuple(position),
                    float(file.targets_mm[target] + deviations[target] * 1e-3 - first),
                )
            )
    return rows, f"linear-{axis}"


def with_runs(
    readings: Readings,
    runs: Sequence[tuple[str, list[tuple[int, int, tuple[float, ...], float]]]],
    source: str,
) -> Readings:
    """Return readings with linear runs added. Raises UsageError for an existing setup or a run
    outside the volume."""
    from stepdiag.base.readings.readings import make_readings

    low, high = readings.position_mm.min(axis=0), readings.position_mm.max(axis=0)
    columns: dict[str, list[object]] = {
        name: [] for name in ("setup", "pass_number", "stop", "position_mm", "reading_mm")
    }
    for setup, rows in runs:
        if setup in (*readings.setup, *columns["setup"]):
            raise UsageError(
                source,
                expected=message("setup-once", setup=setup),
                found=message("twice-readings-two-files"),
            )
        for number, stop, position, reading in rows:
            if (np.array(position) < low - 1.0).any() or (
                np.array(position) > high + 1.0
            ).any():
                place = ", ".join(f"{each:g}" for each in position)
                volume = " to ".join(str(np.round(each, 3).tolist()) for each in (low, high))
                remedy = message("targets-count-machine-coordinates")
                raise UsageError(
                    f"{source}: {setup}",
                    expected=message("targets-within-mm", volume=volume),
                    found=f"({place})",
                    remedy=remedy,
                )
            for name, value in zip(
                columns, (setup, number, stop, position, reading), strict=True
            ):
                columns[name].append(value)
    added = make_readings(**columns)  # type: ignore[arg-type]
    others = [name for name in Readings.__dataclass_fields__ if name != "setup"]
    joined = {
        name: np.concatenate([getattr(readings, name), getattr(added, name)])
        for name in others
    }
    return Readings(setup=(*readings.setup, *added.setup), **joined)


def render_rtl(readings: Readings, setup: str, texts: Mapping[str, str]) -> str:
    """Return the text of an .rtl file with the passes of a linear run, line ends CRLF. ``texts``
    are written into USER-TEXT.

    Raises DataError for passes with different targets.
    """
    index = "xyz".index(setup[-1])
    passes = {
        key.number: rows for key, rows in readings.passes().items() if key.setup == setup
    }
    if 1 not in passes:
        raise DataError(
            setup,
            expected=message("outward-pass"),
            found=message("these-passes", passes=sorted(passes)),
        )
    targets = readings.position_mm[passes[1], index]
    deviations = []
    for number, rows in sorted(passes.items()):
        at, off = readings.position_mm[rows, index], readings.reading_mm[rows]
        outward = PassKey(setup, number).outward
        if (
            len(at) != len(targets)
            or np.abs((at if outward else at[::-1]) - targets).max() > 1e-3
        ):
            raise DataError(
                f"{setup}, pass {number}",
                expected=message("targets-first-pass"),
                found=message("other-ones"),
            )
        run = (off - off[0] - (at - at[0])) * 1e3
        deviations.append(run if outward else run[::-1])
    return _written(
        setup[-1].upper(), targets, deviations, both_ways=len(passes) > 1, texts=texts
    )


def _written(
    axis: str,
    targets: Vector,
    deviations: Sequence[Vector],
    *,
    both_ways: bool,
    texts: Mapping[str, str],
) -> str:
    lines = [
        "HEADER::",
        "File type : Linear",
        "Owner : stepdiag",
        "Version no : 1",
        "TARGET DATA::",
        "Filetype : ISO",
    ]
    lines += [f"Target-count : {len(targets)}", "Targets :"]
    lines += [
        " ".join(f"{value:.6f}" for value in targets[first : first + _A_LINE])
        for first in range(0, len(targets), _A_LINE)
    ]
    lines += [
        f"Flags : {'0 0 2 0' if both_ways else '0 1 2 0'}",
        "USER-TEXT::",
        f"Axis : {axis}",
    ]
    lines += [f"{key} : {' '.join(value.split())}" for key, value in texts.items()]
    lines += ["RUNS::", f"Run-count : {len(deviations)}", "DEVIATIONS::", "Run Target Data:"]
    for run, values in enumerate(deviations, 1):
        order = (
            range(len(targets))
            if run % 2 or not both_ways
            else range(len(targets) - 1, -1, -1)
        )
        lines += [f"{run} {target + 1} {values[target]:.4f}" for target in order]
    return "\r\n".join([*lines, "EQUIPMENT::", "ENVIRONMENT::", "EOF::", ""])
