"""Rules of style that the linter does not have."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
FLOORS = ("daq", "solver", "exporters", "stepdiag")


def nested_conditionals(tree: ast.Module) -> Iterator[int]:
    """Yield the lines of conditional expressions that hold another."""
    for node in ast.walk(tree):
        if isinstance(node, ast.IfExp):
            held = (inner for inner in ast.walk(node) if inner is not node)
            if any(isinstance(inner, ast.IfExp) for inner in held):
                yield node.lineno


def test_no_condition_holds_another() -> None:
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
        "g(1 if a else 2 if b else 3)\ng(1 if a else 2)\nc = 1 if a else (2 if b else 3)\n"
    )
    assert sorted(nested_conditionals(ast.parse(source))) == [2, 3, 5]
