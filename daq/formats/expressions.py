"""Signals that the machine does not send outright: a small typed language over named bits and
words.

    either     = both { "or" both }
    both       = negated { "and" negated }
    negated    = "not" negated | compared
    compared   = operand [ ("==" | "!=" | "<" | "<=" | ">" | ">=") operand ]
    operand    = NAME | NUMBER | "latch" "(" NAME ")" | "(" either ")"

A bit is yes or no, a word a number; a mixture is refused at its place. ``latch(word)`` is the last
value of the word that was not 0: a counter that a control clears between two stops keeps its
number. A value that was not read is unknown, and so is every result that depends on it.
"""

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message

Kind = Literal["bit", "word"]
Value = bool | float | None
Inputs = Mapping[str, float | None]
"""The values read, by name, before they are taken as bits or words; None for a value that the
machine refused.
"""
MOST_CHARACTERS = 500
DEEPEST = 20
"""Levels of brackets and of not."""
_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>==|!=|<=|>=|<|>|\(|\)|-)"
    r"|(?P<odd>\S))",
    re.ASCII,
)
_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_WORDS = ("and", "or", "not", "latch")
_WANTED = {"bit": message("wanted-bit"), "word": message("wanted-word")}


@dataclass(slots=True)
class Memory:
    """The values held by the latches of one stream of polls."""

    last: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression; ``names`` are the inputs it needs."""

    kind: Kind
    names: frozenset[str]
    value: Callable[[Inputs, Memory], Value]


@dataclass(frozen=True, slots=True)
class _Token:
    text: str
    what: str
    at: int


def parse_expression(text: str, kinds: Mapping[str, Kind], where: str) -> Expression:
    """Return the expression of a text; ``kinds`` are the inputs it may name, ``where`` the field
    that holds it.

    Raises UsageError that points at the first character not understood.
    """
    return _Parser(text, kinds, where).whole()


class _Parser:
    """One pass over the tokens, a method a line of the grammar."""

    def __init__(self, text: str, kinds: Mapping[str, Kind], where: str) -> None:
        self._text, self._kinds, self._where = text, kinds, where
        self._tokens = [] if len(text) > MOST_CHARACTERS else _tokens(text)
        self._next = self._depth = 0
        if len(text) > MOST_CHARACTERS:
            raise UsageError(
                where,
                expected=message("characters-most", count=MOST_CHARACTERS),
                found=str(len(text)),
            )

    def whole(self) -> Expression:
        found = self._either()
        if self._here.what != "end":
            raise self._refusal(message("expression-goes-on"))
        return found

    @property
    def _here(self) -> _Token:
        return self._tokens[self._next]

    def _takes(self, *texts: str) -> str:
        """Step over the token and return its text if ``texts`` holds it, else nothing."""
        text = self._here.text
        if self._here.what == "odd" or text not in texts:
            return ""
        self._next += 1
        return text

    def _either(self) -> Expression:
        at, left = self._here, self._both()
        while self._takes("or"):
            left, at = (
                _joined(self._bit(left, at), self._bit_of(self._both), decided_by=True),
                self._here,
            )
        return left

    def _both(self) -> Expression:
        at, left = self._here, self._negated()
        while self._takes("and"):
            left, at = (
                _joined(self._bit(left, at), self._bit_of(self._negated), decided_by=False),
                self._here,
            )
        return left

    def _negated(self) -> Expression:
        if self._takes("not"):
            inner = self._deeper(lambda: self._bit_of(self._negated))
            return Expression(
                "bit", inner.names, lambda inputs, memory: _not(inner.value(inputs, memory))
            )
        return self._compared()

    def _compared(self) -> Expression:
        at, left = self._here, self._operand()
        sign = self._takes(*_COMPARISONS)
        if not sign:
            return left
        left, at = self._of("word", left, at), self._here
        right = self._of("word", self._operand(), at)
        return _compared(left, right, _COMPARISONS[sign])

    def _operand(self) -> Expression:
        token = self._here
        if self._takes("("):
            inner = self._deeper(self._either)
            self._must(")")
            return inner
        if self._takes("latch"):
            return self._latch()
        if token.what == "number" or token.text == "-":
            return self._number()
        if token.what == "name" and token.text not in _WORDS:
            self._next += 1
            return self._named(token)
        raise self._refusal(message("expression-begins"))

    def _number(self) -> Expression:
        minus = bool(self._takes("-"))
        if self._here.what != "number":
            raise self._refusal(message("a-number"))
        figure = -float(self._here.text) if minus else float(self._here.text)
        self._next += 1
        return Expression("word", frozenset(), lambda _inputs, _memory: figure)

    def _named(self, token: _Token) -> Expression:
        name = token.text
        if name not in self._kinds:
            raise self._refusal(message("one-of", names=sorted(self._kinds) or ["-"]), token)
        if self._kinds[name] == "bit":
            return Expression(
                "bit",
                frozenset([name]),
                lambda inputs, _: None if inputs[name] is None else bool(inputs[name]),
            )
        return Expression("word", frozenset([name]), lambda inputs, _: inputs[name])

    def _latch(self) -> Expression:
        self._must("(")
        token = self._here
        self._next += token.what == "name"
        inner = self._of("word", self._named(token), token)
        self._must(")")

        def kept(inputs: Inputs, memory: Memory) -> Value:
            now = inputs[token.text]
            if now:
                memory.last[token.text] = now
            return memory.last.get(token.text, now)

        return Expression("word", inner.names, kept)

    def _deeper(self, part: Callable[[], Expression]) -> Expression:
        self._depth += 1
        if self._depth > DEEPEST:
            raise self._refusal(message("levels-at-most", count=DEEPEST))
        found = part()
        self._depth -= 1
        return found

    def _must(self, text: str) -> None:
        if not self._takes(text):
            raise self._refusal(text)

    def _bit_of(self, part: Callable[[], Expression]) -> Expression:
        at = self._here
        return self._bit(part(), at)

    def _bit(self, found: Expression, at: _Token) -> Expression:
        return self._of("bit", found, at)

    def _of(self, kind: Kind, found: Expression, at: _Token) -> Expression:
        if found.kind != kind:
            raise self._refusal(_WANTED[kind], at)
        return found

    def _refusal(self, expected: Words, at: _Token | None = None) -> UsageError:
        token = at or self._here
        found = message(
            "at-character", token=repr(token.text), place=token.at + 1, text=repr(self._text)
        )
        if not token.text:
            found = message("end-of-text", text=repr(self._text))
        return UsageError(self._where, expected=expected, found=found)


def _tokens(text: str) -> list[_Token]:
    """Return the tokens of a text, an empty one at its end."""
    tokens, at = [], 0
    while found := _TOKEN.match(text, at):
        what = str(found.lastgroup)
        tokens.append(_Token(found[what], what, found.start(what)))
        at = found.end()
    return [*tokens, _Token("", "end", len(text))]


def _joined(left: Expression, right: Expression, *, decided_by: bool) -> Expression:
    """Return both or either of two bits: a bit equal to ``decided_by`` settles the result, even if
    the other is unknown.
    """

    def value(inputs: Inputs, memory: Memory) -> Value:
        sides = left.value(inputs, memory), right.value(inputs, memory)
        if decided_by in sides:
            return decided_by
        return None if None in sides else not decided_by

    return Expression("bit", left.names | right.names, value)


def _compared(
    left: Expression, right: Expression, holds: Callable[[float, float], bool]
) -> Expression:
    def value(inputs: Inputs, memory: Memory) -> Value:
        one, other = left.value(inputs, memory), right.value(inputs, memory)
        return None if one is None or other is None else holds(one, other)

    return Expression("bit", left.names | right.names, value)


def _not(value: Value) -> Value:
    return None if value is None else not value
