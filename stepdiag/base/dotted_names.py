"""Dotted names of a TOML text: time and memory of the TOML reader grow with the square of the
number of their parts.

Every character is looked at once, in any text: each kind of token takes all that could be part of
it, closed or not.
"""

import re
from typing import NamedTuple

_TOKEN = re.compile(
    r'''"""[^"\\]*+(?:(?:\\(?s:.)|"(?!""))[^"\\]*+)*(?:"{3,5})?'''
    r"""|'''[^']*+(?:'(?!'')[^']*+)*(?:'{3,5})?"""
    r"""|#[^\n]*+"""
    r"""|(?P<part>[\w-]++|"[^"\\\n]*+(?:\\.[^"\\\n]*+)*"?|'[^'\n]*+'?)"""
    r"""|(?P<joint>[ \t]*+\.[ \t]*+)"""
    r"""|[ \t]++|[^\w"'#. \t-]++"""
)


class DottedName(NamedTuple):
    """A name up to the first part too many, and its line, from 1."""

    line: int
    text: str


def longer_than(most: int, text: str) -> DottedName | None:
    """Return the first dotted name of more than ``most`` parts outside of comments and texts of
    several lines; None where there is none."""
    begin, parts, joined = 0, 0, False
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "joint":
                joined = parts > 0
            case "part":
                begin, parts, joined = (
                    (begin, parts + 1, False) if joined else (token.start(), 1, False)
                )
                if parts > most:
                    return DottedName(text.count("\n", 0, begin) + 1, text[begin : token.end()])
            case _:
                parts, joined = 0, False
    return None
