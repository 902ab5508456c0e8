"""Every event that the daemon can say stands in docs/events.md, and nothing else does."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from stepdiag.daq.records.status import LinkState

ROOT = Path(__file__).parents[3]
LEVELS = frozenset({"info", "warning", "error", "say"})
"""Debug lines are for developers. ``say`` is a level chosen where it stands."""
LOGS = frozenset({"_log", "log"})


def documented() -> set[str]:
    """Return the events of docs/events.md."""
    return set(
        re.findall(
            r"^\| `([a-z-]+)` \|",
            (ROOT / "docs" / "events.md").read_text(encoding="utf-8"),
            re.MULTILINE,
        )
    )


def said() -> Iterator[str]:
    """Yield every event that is written out in a call of a logger; of a link's states, those that
    are put together."""
    for path in (
        path
        for folder in ("daq", "stepdiag")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if "virtual" not in path.parts
    ):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(call, ast.Call)
                and _logs(call.func)
                and call.args
                and isinstance(call.args[0], ast.Constant)
            ):
                yield call.args[0].value
    yield from (f"link-{state}" for state in LinkState.__args__)


def _logs(function: ast.expr) -> bool:
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        return function.value.id in LOGS and function.attr in LEVELS
    return isinstance(function, ast.Name) and function.id == "say"


def test_events_and_documentation_agree() -> None:
    """No event without its line, no line without its event."""
    events = {event for event in said() if event != "start"}
    assert events == documented()
