"""A JSON document walked with its path, so that a refusal can name the field."""

import json
import re
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from stepdiag.base.csv_table import LARGEST
from stepdiag.base.errors import DataError
from stepdiag.base.messages import Said, excerpt, message
from stepdiag.base.volume import Vector

DEEPEST = 20
"""Levels of a tree that is kept as it is."""
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def load_json(text: str, source: str) -> "Node":
    """Return the root of a JSON document. Raises ``DataError`` where the text is none."""
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise DataError(f"{source}: line {error.lineno}", expected="a JSON document", found=error.msg) from None
    except RecursionError:
        raise DataError(source, expected="a JSON document", found="brackets nested beyond reason") from None
    except ValueError as error:  # Python reads no whole number of more than 4300 digits
        raise DataError(source, expected="a JSON document", found=str(error)) from None
    if _SURROGATE.search(text) and not _encodable(value):
        raise DataError(source, expected="a JSON document", found="half of a surrogate pair: such a text cannot be written again")
    return Node(value, source, "")


def _encodable(value: Any) -> bool:
    try:
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Node:
    """A value in the document and where it stands. Every reader raises ``DataError`` with that place for anything it does not expect."""

    value: Any
    source: str
    path: str

    def refuse(self, expected: Said) -> NoReturn:
        raise DataError(f"{self.source}: {self.path or 'document'}", expected=expected, found=excerpt(json.dumps(self.value)))

    def mapping(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            self.refuse("an object")
        return self.value

    def child(self, name: str) -> "Node":
        inside = self.mapping()
        path = f"{self.path}.{name}" if self.path else name
        if name not in inside:
            raise DataError(
                f"{self.source}: {path}", expected="this entry", found=message("nothing"), remedy="this is no complete result of stepdiag"
            )
        return Node(inside[name], self.source, path)

    def items(self) -> list["Node"]:
        if not isinstance(self.value, list):
            self.refuse("a list")
        return [Node(item, self.source, f"{self.path}[{index}]") for index, item in enumerate(self.value)]

    def equals(self, name: str, wanted: str | int) -> None:
        found = self.child(name)
        if type(found.value) is not type(wanted) or found.value != wanted:
            found.refuse(repr(wanted))

    def text(self, name: str) -> str:
        found = self.child(name)
        if not isinstance(found.value, str):
            found.refuse(message("text"))
        return found.value

    def texts(self) -> tuple[str, ...]:
        for item in self.items():
            if not isinstance(item.value, str):
                item.refuse(message("text"))
        return tuple(self.value)

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not abs(self.value) <= LARGEST:
            self.refuse(message("finite"))
        return float(self.value)

    def plain(self, levels: int = DEEPEST) -> Any:
        """Return the value as it stands: any tree that is not too deep and whose numbers are finite."""
        if levels == 0:
            self.refuse(f"at most {DEEPEST} levels")
        if isinstance(self.value, dict):
            return {name: self.child(name).plain(levels - 1) for name in self.value}
        if isinstance(self.value, list):
            return [item.plain(levels - 1) for item in self.items()]
        if self.value is not None and not isinstance(self.value, str | bool):
            self.number()
        return self.value

    def truth(self) -> bool:
        if not isinstance(self.value, bool):
            self.refuse(message("bool"))
        return self.value

    def numbers(self) -> Vector:
        return np.array([item.number() for item in self.items()], dtype=np.float64)
