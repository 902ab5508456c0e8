"""Reading of settings files (TOML) into msgspec models, with error messages for the author of the
file.

msgspec reports wrong values in its own words. So this module checks each field separately: the
message contains the name of the field in the file, the expected type and limits, and the found
value. For an unknown key, the message contains the nearest known key. A value ``"?"`` is an open
question.
"""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import inspect

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Message, Words, excerpt, message, message_of

Model = TypeVar("Model", bound=msgspec.Struct)

UNANSWERED: Literal["?"] = "?"
_DEEPEST = 20
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_NAME = re.compile(rf"(?<![\w\\-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_DEEPEST}}}")
"""Pattern of a name with too many parts. Time and memory of the TOML reader grow with the square of
the number of parts (1 GB for a name of 32 kB). A comment or text of this form is refused too. A
match does not begin after a backslash, because the time of the search would otherwise grow with the
square of the number of escaped quotes."""
_PLAIN: dict[type[inspect.Type], Message] = {
    inspect.BoolType: message("true-or-false"),
    inspect.DictType: message("a-table"),
    inspect.StructType: message("a-table"),
    inspect.DateType: message("a-date", example="2026-05-31"),
}


def read_toml(text: str, source: str) -> dict[str, Any]:
    """Return the tables of a TOML text; a byte order mark is skipped. Raises ``UsageError`` with
    the line of the fault."""
    text = text.removeprefix("\ufeff")
    if deep := _LONG_NAME.search(text):
        raise UsageError(
            f"{source}: line {text.count(chr(10), 0, deep.start()) + 1}",
            expected=message("names-at-most-parts", deepest=_DEEPEST),
            found=show(deep.group()),
        )
    try:
        return tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # tomllib raises ValueError for whole numbers of thousands of digits, too
        raise UsageError(source, expected="TOML", found=str(error)) from error


def require_answers(data: object, source: str) -> None:
    """Raise ``UsageError`` with the list of all open questions of a template."""
    questions = list(_unanswered(data, ""))
    if questions:
        remedy = message("unanswered", names=questions)
        raise UsageError(
            f"{source}: {questions[0]}",
            expected=message("an-answer"),
            found=f'"{UNANSWERED}"',
            remedy=remedy,
        )


def convert(data: object, model: type[Model], source: str, at: str = "") -> Model:
    """Return ``data`` as a ``model``; ``at`` is its path within the file. Raises ``UsageError`` for
    the first wrong field."""
    _check(data, model, source, at)
    return msgspec.convert(data, model)


def nearest(word: str, known: list[str]) -> Message:
    """Return a remedy with the nearest known word, or with all known words."""
    close = _close(word, known)
    return (
        message("did-you-mean-near", near=close)
        if close
        else message("known-names", names=known)
    )


def unknown_key(source: str, path: str, key: str, known: list[str]) -> UsageError:
    """Return the error for an unknown key, with the nearest known key."""
    remedy = nearest(key, known) if _close(key, known) else ""
    return UsageError(
        f"{source}: {path}",
        expected=message("one-of", names=sorted(known)),
        found=message("unknown-name", name=key),
        remedy=remedy,
    )


def refuse(
    source: str, field: str, expected: Words, found: object, remedy: Words = ""
) -> UsageError:
    """Return the error for one field: ``survey.toml: plc.poll_hz: expected a number above 0, found
    "fast"``."""
    shown = found if isinstance(found, Message) else show(found)
    if isinstance(found, dict):
        shown = message("a-table")
    return UsageError(
        f"{source}: {field}" if field else source,
        expected=expected,
        found=shown,
        remedy=remedy,
    )


def show(value: object) -> str:
    """Return a value in its form in the file; a long value is shortened."""
    return excerpt(json.dumps(value, ensure_ascii=False, default=str))


def expectation(info: inspect.Type) -> Words:
    """Return the requirement of a field in words: ``a number above 0``, ``one of "E", "N", "O"``.

    For a text with a pattern, the ``description`` of its ``Meta`` is the key of a message.
    """
    match info:
        case inspect.LiteralType():
            return message(
                "one-of", names=[show(value) for value in sorted(info.values, key=str)]
            )
        case inspect.IntType() | inspect.FloatType():
            return _limited(
                message("whole-number")
                if isinstance(info, inspect.IntType)
                else message("a-number"),
                info,
            )
        case inspect.Metadata(extra_json_schema={"description": str(key)}):
            return message_of({"key": key, "arguments": {}}) or key
        case inspect.StrType():
            return message("a-text-not-empty") if info.min_length else message("a-text")
        case inspect.TupleType():
            return message(
                "values-each",
                count=len(info.item_types),
                kind=expectation(info.item_types[0]),
            )
        case inspect.ListType() if info.min_length and info.min_length == info.max_length:
            return message(
                "list-of-each", count=info.min_length, kind=expectation(info.item_type)
            )
        case inspect.ListType() | inspect.VarTupleType():
            return message("list-each", kind=expectation(info.item_type))
        case _:
            return _PLAIN[type(info)]


def _unanswered(value: object, at: str) -> Iterator[str]:
    if value == UNANSWERED:
        yield at
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _unanswered(inner, f"{at}.{key}".lstrip("."))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _unanswered(inner, f"{at}[{index}]")


def _close(word: str, known: list[str]) -> str:
    return next(iter(difflib.get_close_matches(word, known, cutoff=0.5)), "")


def _check(value: object, hint: Any, source: str, path: str) -> None:
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        _check_struct(_settings_table(value, source, path), hint, source, path)
    elif get_origin(hint) is dict:
        key_hint, item_hint = get_args(hint)
        keys = get_args(key_hint)
        for key, item in _settings_table(value, source, path).items():
            if keys and key not in keys:
                raise unknown_key(source, f"{path}.{key}", key, list(keys))
            _check(item, item_hint, source, f"{path}.{key}")
    elif isinstance(value, list) and (item_hints := _item_hints(hint, len(value))):
        for index, (item, item_hint) in enumerate(zip(value, item_hints, strict=True)):
            _check(item, item_hint, source, f"{path}[{index}]")
    else:
        _check_leaf(value, hint, source, path)


def _item_hints(hint: Any, count: int) -> tuple[Any, ...]:
    parts = get_args(hint)
    if get_origin(hint) is list or (get_origin(hint) is tuple and parts[-1] is Ellipsis):
        return (parts[0],) * count
    return parts if get_origin(hint) is tuple and len(parts) == count else ()


def _check_struct(
    table: dict[str, Any], model: type[msgspec.Struct], source: str, path: str
) -> None:
    prefix = f"{path}." if path else ""
    known = {field.encode_name: field for field in msgspec.structs.fields(model)}
    for key in table:
        if key not in known:
            raise unknown_key(source, prefix + key, key, list(known))
    for name, field in known.items():
        if name in table:
            _check(table[name], field.type, source, prefix + name)
        elif field.required:
            expected = expectation(inspect.type_info(field.type))
            raise UsageError(
                f"{source}: {prefix}{name}",
                expected=expected,
                found=message("nothing"),
                remedy=message("add-it"),
            )


def _settings_table(value: object, source: str, path: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise refuse(source, path, message("a-table"), value)
    return value


def _check_leaf(value: object, hint: Any, source: str, path: str) -> None:
    try:
        converted = msgspec.convert(value, hint)
    except msgspec.ValidationError:
        converted = math.nan
    endless = isinstance(converted, int | float) and not abs(converted) <= LARGEST
    if endless or (
        isinstance(converted, str) and "\0" in converted
    ):  # for the operating system a NUL ends a name
        raise refuse(source, path, expectation(inspect.type_info(hint)), value)


def _limited(kind: Message, info: inspect.IntType | inspect.FloatType) -> Message:
    if info.ge is not None and info.le is not None:
        return message("number-from-to", kind=kind, low=info.ge, high=info.le)
    limits = [message("limit-above", limit=info.gt)] if info.gt is not None else []
    limits += [message("limit-or-more", limit=info.ge)] if info.ge is not None else []
    limits += [message("limit-at-most", limit=info.le)] if info.le is not None else []
    limits += [message("limit-below", limit=info.lt)] if info.lt is not None else []
    return message("number-limited", kind=kind, limits=limits) if limits else kind
