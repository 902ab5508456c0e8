"""Rules of style that the linter does not have."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
FLOORS = ("daq", "solver", "exporters", "stepdiag")


def nested_conditionals(tree: ast.Module) -> Iterator[int]:
    """Yield the lines of returns and arguments that hold a conditional expression within
    another."""
    for node in ast.walk(tree):
        held = [node.value] if isinstance(node, ast.Return) else []
        held += (
            [*node.args, *(keyword.value for keyword in node.keywords)]
            if isinstance(node, ast.Call)
            else []
        )
        conditions = [each for each in held if isinstance(each, ast.IfExp)]
        yield from (
            each.lineno
            for each in conditions
            for inner in ast.walk(each)
            if inner is not each and isinstance(inner, ast.IfExp)
        )


def test_no_return_and_no_argument_holds_a_condition_within_a_condition() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for floor in FLOORS
        for path in sorted((ROOT / floor).rglob("*.py"))
        for line in nested_conditionals(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def test_the_search_finds_one() -> None:
    source = (
        "def f(a):\n    return 1 if a else 2 if a is None else 3\n"
        "g(1 if a else 2 if b else 3)\ng(1 if a else 2)\nc = 1 if a else 2 if b else 3\n"
    )
    assert list(nested_conditionals(ast.parse(source))) == [2, 3]
