"""The page of the capture's numbers holds each of them once, and counts them."""

import ast
import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
CAPTURE = CHECKOUT / "daq" / "capture"
PAGE = (CHECKOUT / "docs" / "capture-numbers.md").read_text(encoding="utf-8")
OF_MATHEMATICS = {("standing/window", "MAD_TO_SIGMA")}


def numbers():
    """Yield the module and name of every numeric constant."""
    for path in CAPTURE.rglob("*.py"):
        module = path.relative_to(CAPTURE).with_suffix("").as_posix()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign):
                target, value = node.targets[0], node.value
                several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
                pairs = (
                    zip(target.elts, value.elts, strict=True)
                    if several
                    else [(target, value)]
                )
                for name, value in pairs:
                    if isinstance(value, ast.Constant) and isinstance(
                        value.value, int | float
                    ):
                        yield module, name.id


def rows(text):
    return re.findall(r"^\| `([\w/]+)` \| `(\w+)` \|", text, flags=re.MULTILINE)


def test_every_number_of_the_capture_stands_on_the_page_once() -> None:
    assert sorted([*rows(PAGE), *OF_MATHEMATICS]) == sorted(numbers())


def test_the_page_counts_its_numbers() -> None:
    parts = re.findall(
        r"^## [^:\n]+: (\d+)\n(.*?)(?=^## |\Z)", PAGE, flags=re.MULTILINE | re.DOTALL
    )
    assert [int(count) for count, _ in parts] == [len(rows(part)) for _, part in parts]
