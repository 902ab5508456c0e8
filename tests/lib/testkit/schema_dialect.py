"""The JSON schema dialect that Foxglove and PlotJuggler both read, as a checker.

The rules are those of the viewers' own schema readers, restated (reference: acquisition.md B2,
rules 3, 4 and 8).
"""

import re
from typing import Any

Schema = dict[str, Any]

_PLAIN_TYPES = ("number", "integer", "string", "boolean")
_TOPIC = re.compile(r"(/[a-z][a-z_]*)+")


def dialect_faults(topic: str, schema: Schema) -> list[str]:
    """Return what a viewer would refuse in a channel, in words; empty when every viewer reads
    it."""
    faults = [] if _TOPIC.fullmatch(topic) else [f"topic {topic}: lower case, parted by /"]
    if schema.get("type") != "object" or not schema.get("properties"):
        faults.append("the root is an object with properties")
    return faults + [
        fault
        for name, part in schema.get("properties", {}).items()
        for fault in _faults(name, part, nested=False)
    ]


def _faults(name: str, part: Schema, *, nested: bool) -> list[str]:
    kind = part.get("type")
    odd = sorted(set(part) & {"$ref", "anyOf", "oneOf", "allOf"})
    if odd:
        return [f"{name}: {odd[0]}"]
    if kind == "object":
        inner = part.get("properties", {})
        own = [] if inner else [f"{name}: object without properties"]
        return own + [
            fault
            for key, value in inner.items()
            for fault in _faults(f"{name}.{key}", value, nested=False)
        ]
    if kind == "array":
        return (
            [f"{name}: array of arrays"]
            if nested
            else _faults(f"{name}[]", part.get("items", {}), nested=True)
        )
    return [] if kind in _PLAIN_TYPES else [f"{name}: type {kind!r} is not one plain type"]
