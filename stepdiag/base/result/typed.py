"""Frozen dataclasses for the members of a result's JSON.

A member has the name of its field unless its annotation contains another name (`Named`). An
`OPTIONAL` member is left out if it has its default value. The entries of a mapping marked `BESIDE`
are written directly among the other members.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message, Words, message, message_json, message_of
from stepdiag.base.result.finding import parse_finding
from stepdiag.base.result.json_tree import Node

OPTIONAL, BESIDE = "optional", "beside"
T = TypeVar("T")
Maybe = Annotated[T | None, OPTIONAL]
_ABSENT = object()


def _words(node: Node) -> Words:
    return (
        node.word()
        if isinstance(node.value, str)
        else message_of(node.mapping()) or node.text("text")
    )


_LEAVES: Mapping[Any, Callable[[Node], Any]] = {
    Words: _words,
    float: Node.number,
    int: Node.whole,
    str: Node.word,
    bool: Node.truth,
    Finding: parse_finding,
}


@dataclass(frozen=True, slots=True)
class Named:
    """The name of a member in the JSON."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class _Member:
    field: Field[Any]
    name: str
    kind: Any
    notes: tuple[Any, ...]


@cache
def _members(kind: Any) -> tuple[_Member, ...]:
    found = []
    for each in fields(kind):
        plain, *notes = (
            get_args(each.type) if get_origin(each.type) is Annotated else (each.type,)
        )
        name = next((note.name for note in notes if isinstance(note, Named)), each.name)
        found.append(_Member(each, name, plain, tuple(notes)))
    return tuple(found)


def written(value: Any) -> Any:
    """Return a value with its dataclasses converted to JSON objects."""
    if isinstance(value, Finding):
        return value.as_json()
    if isinstance(value, Message):
        return {"text": str(value), **message_json(value)}
    if is_dataclass(value):
        entries: dict[str, Any] = {}
        kind: Any = type(value)
        for each in _members(kind):
            found = getattr(value, each.field.name)
            if BESIDE in each.notes:
                entries |= written(found)
            elif OPTIONAL not in each.notes or found != each.field.default:
                entries[each.name] = written(found)
        return entries
    if isinstance(value, Mapping):
        return {name: written(item) for name, item in value.items()}
    return [written(item) for item in value] if isinstance(value, list | tuple) else value


def read(node: Node, kind: Any) -> Any:
    """Return a JSON value as the type ``kind``: a dataclass, mapping, tuple, choice, number, text,
    bool or None.

    A mapping whose keys are a choice must contain every key of the choice. A strict node raises
    ``DataError`` for the first field that is unknown, missing or of another type. A node that is
    not strict ignores unknown names, damaged entries of mappings, and damaged members that may be
    missing.
    """
    if kind in _LEAVES:
        return _LEAVES[kind](node)
    if is_dataclass(kind):
        return _object(node, kind)
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        (kind,) = (part for part in parts if part is not NoneType)
        return None if node.value is None else read(node, kind)
    if origin is Literal:
        if not isinstance(node.value, str) or node.value not in parts:
            node.refuse(message("one-of", names=list(parts)))
        return node.value
    if origin is dict:
        return _entries(node, list(node.mapping()), *parts)
    return _items(node, parts)


def read_or_none(node: Node, kind: Any) -> Any:
    """Return the value of `read`; None for a damaged value of a node that is not strict."""
    found = _kept(node, kind)
    return None if found is _ABSENT else found


def _kept(node: Node, kind: Any) -> Any:
    if node.strict:
        return read(node, kind)
    try:
        return read(node, kind)
    except DataError:
        return _ABSENT


def _object(node: Node, kind: Any) -> Any:
    known = {each.name: each for each in _members(kind) if BESIDE not in each.notes}
    beside = next((each for each in _members(kind) if BESIDE in each.notes), None)
    others = [name for name in node.mapping() if name not in known]
    if beside is None:
        node.only(known)
    found: dict[str, Any] = (
        {}
        if beside is None
        else {beside.field.name: _entries(node, others, *get_args(beside.kind))}
    )
    for name, each in known.items():
        there = name in node.value or (node.strict and OPTIONAL not in each.notes)
        value = _kept(node.child(name), each.kind) if there else _ABSENT
        if value is not _ABSENT:
            found[each.field.name] = value
        elif each.field.default is MISSING:
            found[each.field.name] = _empty(node, name, each.kind)
    return kind(**found)


def _empty(node: Node, name: str, kind: Any) -> Any:
    origin = get_origin(kind)
    if origin in (Union, UnionType):
        return None
    if (origin is dict and get_args(kind)[0] is str) or (
        origin is tuple and get_args(kind)[-1] is Ellipsis
    ):
        return origin()
    return read(node.child(name), kind)


def _entries(node: Node, names: list[str], key: Any, kind: Any) -> dict[str, Any]:
    if get_origin(key) is Literal:
        node.only(get_args(key))
        return {name: read(node.child(name), kind) for name in get_args(key)}
    found = {name: _kept(node.child(name), kind) for name in names}
    return {name: value for name, value in found.items() if value is not _ABSENT}


def _items(node: Node, parts: tuple[Any, ...]) -> tuple[Any, ...]:
    items = node.items()
    if parts[-1] is Ellipsis:
        return tuple(read(item, parts[0]) for item in items)
    if len(items) != len(parts):
        node.refuse(f"{len(parts)} values")
    return tuple(read(item, part) for item, part in zip(items, parts, strict=True))
