"""Reference data: recorded inputs with everything that the program made of them
(tests/data/reference/README.md).

A file is one case: ``about``, the name of its ``call``, ``input`` and ``output``. A floor names its
calls: functions of the input, as JSON.
"""

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec
import numpy as np

from stepdiag.base.errors import StepdiagError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message

FOLDER = Path(__file__).parents[3] / "data" / "reference"
RELATIVE, ABSOLUTE = 1e-6, 1e-9
"""Numbers are the same within one of these: another processor rounds otherwise, a change of the
program is larger."""
OF_U = 0.01
"""A value that carries its standard uncertainty is the same within this share of it; the
uncertainty within this share of itself."""
DIGITS = 10
MOST_NAMED = 20
FINDING = ("code", "severity", "setup", "pass_number", "stop", "size_um", "among")
_SCALARS = re.compile(r'"(?:[^"\\]|\\.)*"|(\[[^][{}"]*\])')
"""A text, in which brackets mean nothing, or a list of numbers: it stands in one line."""

_NUMBERS = re.compile(r"((?<![\w.])-?(?:0|[1-9]\d*)(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]))")
"""Numbers in a text; not those in a name."""

Call = Callable[[dict], object]


def plain(value: object) -> object:
    """Return JSON of anything that the program returns: a NaN as text, a number to `DIGITS`, fields
    by name, bytes in hexadecimal.

    A message is its key and its arguments in one text, never its words.
    """
    if isinstance(value, Message):
        return " ".join(
            [
                value.key,
                *(f"{name}={_argument(item)}" for name, item in value.arguments.items()),
            ]
        )
    if isinstance(value, Finding):
        return {"message": plain(value.message or value.text)} | {
            name: plain(getattr(value, name)) for name in FINDING
        }
    if dataclasses.is_dataclass(value):
        return {
            field.name: plain(getattr(value, field.name))
            for field in dataclasses.fields(value)
        }
    if isinstance(value, msgspec.Struct):
        return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [
            plain(item)
            for item in (sorted(value) if isinstance(value, set | frozenset) else value)
        ]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else str(value)
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _argument(value: object) -> str:
    """Return an argument of a message in its text."""
    if isinstance(value, tuple):
        return f"[{', '.join(_argument(item) for item in value)}]"
    return f"({plain(value)})" if isinstance(value, Message) else str(plain(value))


def refused(call: Call, given: object) -> object:
    """Return what a call makes of one input: its refusal in every part, or what it returned."""
    try:
        return plain(call(given))
    except StepdiagError as error:
        parts = {
            name: plain(getattr(error, name))
            for name in ("where", "expected", "found", "remedy")
        }
        return {"refusal": type(error).__name__, **parts}


def rendered(case: Mapping) -> str:
    """Return the text of a case: lists of numbers in one line, the same bytes for the same case."""
    text = json.dumps(case, indent=1, ensure_ascii=False, allow_nan=False)
    return (
        _SCALARS.sub(
            lambda found: re.sub(r"\s+", "", found[1]) if found[1] else found[0], text
        )
        + "\n"
    )


def same(was: float, now: float) -> bool:
    """Tell whether two numbers are the same but for rounding; whole numbers are only where they are
    equal."""
    if isinstance(was, int) and isinstance(now, int):
        return was == now
    return math.isclose(was, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE)


def _same_text(was: str, now: str) -> bool:
    """Tell whether two texts are the same but for the rounding of the numbers in them, such as the
    arguments of a message."""
    before, after = _NUMBERS.split(was), _NUMBERS.split(now)
    numbers = [[json.loads(number) for number in parts[1::2]] for parts in (before, after)]
    return before[::2] == after[::2] and all(map(same, *numbers))


def _within_u(was: Mapping, now: Mapping) -> bool:
    """Tell whether two figures with ``value`` and ``u`` (numbers, or lists of them) are the same
    within the tolerance of the promise."""
    if not all(
        isinstance(each.get(name), int | float | list)
        for each in (was, now)
        for name in ("value", "u")
    ):
        return False
    try:
        value, u = (
            [np.asarray(each[name], dtype=float) for each in (was, now)]
            for name in ("value", "u")
        )
    except (TypeError, ValueError):  # of an unknown value
        return False
    alike = value[0].shape == value[1].shape == u[0].shape == u[1].shape
    return alike and bool(
        np.all(abs(value[0] - value[1]) <= OF_U * u[0] + ABSOLUTE)
        and np.all(abs(u[0] - u[1]) <= OF_U * u[0] + ABSOLUTE)
    )


def differences(was: object, now: object, place: str = "output") -> Iterator[str]:
    """Yield every place where two trees differ, with what it was and what it is."""
    if isinstance(was, dict) and isinstance(now, dict):
        if _within_u(was, now):
            now = now | {name: was[name] for name in ("value", "u")}
        for name in [*was, *(name for name in now if name not in was)]:
            yield from differences(
                was.get(name, "(not there)"), now.get(name, "(not there)"), f"{place}.{name}"
            )
        if list(was) != list(now) and sorted(was) == sorted(now):
            yield f"{place}: was in the order {list(was)}, is in the order {list(now)}"
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for index, (before, after) in enumerate(zip(was, now, strict=True)):
            yield from differences(before, after, f"{place}[{index}]")
    elif (
        isinstance(was, bool)
        or isinstance(now, bool)
        or not (isinstance(was, int | float) and isinstance(now, int | float))
    ):
        if type(was) is not type(now) or (
            was != now and not (isinstance(was, str) and _same_text(was, str(now)))
        ):
            yield f"{place}: was {was!r}, is {now!r}"
    elif not same(was, now):
        yield f"{place}: was {was!r}, is {now!r}"


def files(floor: str) -> list[Path]:
    """Return the cases of a floor."""
    return sorted((FOLDER / floor).glob("*.json"))


def check(path: Path, calls: Mapping[str, Call]) -> None:
    """Fail with every place where the program makes something else of a recorded input than it
    did."""
    case = json.loads(path.read_text(encoding="utf-8"))
    now = json.loads(rendered({"output": plain(calls[case["call"]](case["input"]))}))[
        "output"
    ]
    found = list(differences(case["output"], now))
    shown = "\n".join(found[:MOST_NAMED])
    assert not found, f"{path.name} ({case['about']}): {len(found)} differences\n{shown}"
