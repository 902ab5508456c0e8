"""What stands for instruments and controls in the tests shares no code with what reads them: or it
would prove its own mistakes."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
STANDING_FOR = [
    *sorted((ROOT / "stepdiag" / "virtual").rglob("*.py")),
    ROOT / "tests" / "lib" / "testkit" / "running" / "controls.py",
]
READS_THEM = (
    "stepdiag.daq",
    "stepdiag.solver",
    "stepdiag.exporters",
    "stepdiag.checking",
    "pyLSV2",
    "snap7.client",
    "pymodbus",
)


def imported(path: Path) -> set[str]:
    """Return the full names of everything that a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{each.name}" for each in node.names}
    return found


@pytest.mark.parametrize("path", STANDING_FOR, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_stand_in_imports_what_reads_it(path: Path) -> None:
    """The S7 server is the library's own, as its client is: its memory is set here, byte by byte;
    all else is from papers."""
    assert {
        name
        for name in imported(path)
        for other in READS_THEM
        if f"{name}.".startswith(f"{other}.")
    } == set()
