"""Reading of a JSON document; every value has its path, which error messages contain."""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import DataError
from stepdiag.base.messages import Words, excerpt, message
from stepdiag.base.volume import Vector

_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def load_json(text: str, source: str) -> "Node":
    """Return the root of a JSON document. Raises ``DataError`` for a text that is not JSON."""
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise DataError(
            f"{source}: line {error.lineno}",
            expected=message("json-document"),
            found=error.msg,
        ) from None
    except RecursionError:
        raise DataError(
            source,
            expected=message("json-document"),
            found=message("brackets-nested-beyond-reason"),
        ) from None
    except ValueError as error:  # Python reads no whole number of more than 4300 digits
        raise DataError(source, expected=message("json-document"), found=str(error)) from None
    if _SURROGATE.search(text) and not _encodable(value):
        raise DataError(
            source,
            expected=message("json-document"),
            found=message("half-surrogate-pair-such"),
        )
    return Node(value, source, "")


def _encodable(value: Any) -> bool:
    try:
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Node:
    """A value in a JSON document and its path. Every reading method raises ``DataError`` with this
    path for an unexpected value."""

    value: Any
    source: str
    path: str
    strict: bool = False
    """Whether members with unknown names are refused."""

    def refuse(self, expected: Words) -> NoReturn:
        raise DataError(
            f"{self.source}: {self.path or 'document'}",
            expected=expected,
            found=excerpt(json.dumps(self.value)),
        )

    def mapping(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            self.refuse(message("an-object"))
        return self.value

    def child(self, name: str) -> "Node":
        inside = self.mapping()
        path = f"{self.path}.{name}" if self.path else name
        if name not in inside:
            raise DataError(
                f"{self.source}: {path}",
                expected=message("this-entry"),
                found=message("nothing"),
                remedy=message("this-no-complete-result"),
            )
        return Node(inside[name], self.source, path, self.strict)

    def only(self, names: Iterable[str]) -> None:
        """Refuse members with unknown names if the node is strict."""
        known = list(names)
        unknown = next((name for name in self.mapping() if name not in known), None)
        if self.strict and unknown is not None:
            place = (
                f"{self.source}: {self.path}.{unknown}"
                if self.path
                else f"{self.source}: {unknown}"
            )
            raise DataError(
                place,
                expected=message("one-of", names=list(known)),
                found=message("unknown-member"),
            )

    def items(self) -> list["Node"]:
        if not isinstance(self.value, list):
            self.refuse("a list")
        return [
            Node(item, self.source, f"{self.path}[{index}]", self.strict)
            for index, item in enumerate(self.value)
        ]

    def equals(self, name: str, wanted: str | int) -> None:
        found = self.child(name)
        if type(found.value) is not type(wanted) or found.value != wanted:
            found.refuse(repr(wanted))

    def text(self, name: str) -> str:
        return self.child(name).word()

    def word(self) -> str:
        if not isinstance(self.value, str):
            self.refuse(message("a-text"))
        return self.value

    def texts(self) -> tuple[str, ...]:
        return tuple(item.word() for item in self.items())

    def whole(self) -> int:
        if type(self.value) is not int or abs(self.value) > LARGEST:
            self.refuse(message("whole-number"))
        return self.value

    def number(self) -> float:
        if (
            isinstance(self.value, bool)
            or not isinstance(self.value, int | float)
            or not abs(self.value) <= LARGEST
        ):
            self.refuse(message("finite-number"))
        return float(self.value)

    def truth(self) -> bool:
        if not isinstance(self.value, bool):
            self.refuse(message("true-or-false"))
        return self.value

    def numbers(self) -> Vector:
        return np.array([item.number() for item in self.items()], dtype=np.float64)
