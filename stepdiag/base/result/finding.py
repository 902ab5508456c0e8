"""The JSON form of a finding in a result."""

from typing import get_args

from stepdiag.base.findings import Finding
from stepdiag.base.messages import message, message_of
from stepdiag.base.result.json_tree import Node
from stepdiag.texts.explained import Action

_NAMES = (
    "code",
    "key",
    "severity",
    "action",
    "place",
    "arguments",
    "text",
    "setup",
    "pass",
    "stop",
    "size_um",
    "among",
)


def parse_finding(node: Node) -> Finding:
    """Return a finding from the JSON of a result. Raises ``DataError`` with the wrong field."""
    node.only(_NAMES)
    severity = node.text("severity")
    if severity not in ("info", "warning", "error"):
        node.child("severity").refuse(message("severity-names"))
    if node.strict and node.text("action") not in get_args(Action):
        node.child("action").refuse(", ".join(get_args(Action)))
    tree = node.mapping()
    return Finding(
        code=node.text("code"),
        severity=severity,  # type: ignore[arg-type]
        text=node.text("text"),
        message=message_of(
            {"key": tree.get("key", tree["code"]), "arguments": tree.get("arguments")}
        ),
        setup=node.text("setup") if "setup" in node.mapping() else "",
        pass_number=_whole_if_there(node, "pass"),
        stop=_whole_if_there(node, "stop"),
        size_um=node.child("size_um").number() if "size_um" in node.mapping() else None,
        among=node.child("among").texts() if "among" in node.mapping() else (),
    )


def _whole_if_there(node: Node, name: str) -> int | None:
    if name not in node.mapping():
        return None
    value = node.child(name).number()
    if not value.is_integer():
        node.child(name).refuse(message("whole-number"))
    return int(value)
