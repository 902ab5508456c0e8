"""Members of a result from their JSON, so that a test writes only the part that it is about."""

from typing import Any

from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.members import SetupReport
from stepdiag.base.result.result import MEMBERS
from stepdiag.base.result.typed import read, read_or_none, written


def members(**given: Any) -> dict[str, Any]:
    """Return the members of a `Result` by name, each read from its JSON as in a result of version
    2: nothing of it is required."""
    return {
        name: read_or_none(Node(written(value), "test", name), MEMBERS[name])
        for name, value in given.items()
    }


def setups(**given: Any) -> dict[str, SetupReport]:
    """Return reports of setups by name, read as `members` are."""
    return {
        name.replace("_", "-"): read(Node(facts, "test", name), SetupReport)
        for name, facts in given.items()
    }
