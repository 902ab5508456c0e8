"""A regular expression that judges a whole text ends in ``\\Z``: ``$`` also lets a line end pass
behind it.

And none keeps what a group has taken (``(...)*+``): Python 3.11.2, which is Debian 12's, matches
that wrongly where a branch of the group has begun and failed (CPython issues 100061 and 106052,
cured in 3.11.5).
"""

import ast
import re
from pathlib import Path

import pytest

import stepdiag

PACKAGE = Path(stepdiag.__file__).parent
FUNCTIONS = {
    "compile",
    "match",
    "search",
    "fullmatch",
    "sub",
    "subn",
    "split",
    "findall",
    "finditer",
}


def patterns(tree: ast.AST) -> list[tuple[int, str]]:
    """Return every literal text that goes into a function of ``re``, or stands as ``pattern=``,
    with its line."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    given = [argument for call in calls if _of_re(call) for argument in call.args[:1]]
    given += [each.value for call in calls for each in call.keywords if each.arg == "pattern"]
    literals = [
        inner
        for each in given
        for inner in ast.walk(each)
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str | bytes)
    ]
    return [
        (
            each.lineno,
            each.value if isinstance(each.value, str) else str(each.value, "latin-1"),
        )
        for each in literals
    ]


def _of_re(call: ast.Call) -> bool:
    return (
        isinstance(call.func, ast.Attribute)
        and call.func.attr in FUNCTIONS
        and ast.unparse(call.func.value) in ("re", "re2")
    )


def of_the_product() -> dict[str, str]:
    """Return every literal pattern by its place."""
    floors = (PACKAGE, *(PACKAGE / floor for floor in ("solver", "exporters", "daq")))
    sources = {path.resolve() for floor in floors for path in floor.resolve().rglob("*.py")}
    return {
        f"{path.name}:{line}": text
        for path in sources
        for line, text in patterns(ast.parse(path.read_text(encoding="utf-8")))
    }


@pytest.mark.parametrize(
    "refused",
    [r"(?<!\\)(?:\\\\)*\$(?![^\[]*\])", r"(?<!\\)(?:\\\\)*\)(?:[*+?]|\{[\d,]*\})\+"],
    ids=["a dollar", "a group kept"],
)
def test_none_has(refused: str) -> None:
    seen = of_the_product()
    assert len(seen) > 40
    assert {place: text for place, text in seen.items() if re.search(refused, text)} == {}
