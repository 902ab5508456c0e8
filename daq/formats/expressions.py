"""Expressions for signals that the machine does not send directly: a small typed language over
named bits and words, a subset of Python's expressions.

    either = both { "or" both }
    both = negated { "and" negated }
    negated = "not" negated | compared
    compared = operand [ ("==" | "!=" | "<" | "<=" | ">" | ">=") operand ]
    operand = NAME | NUMBER | "latch" "(" NAME ")" | "(" either ")"

A bit is yes or no; a word is a number. An expression that mixes bits and words is refused.
``latch(word)`` is the last value of the word that was not 0: it keeps a stop number that the
control clears between two stops. A value that was not read is unknown, and every result that
depends on an unknown value is unknown.

Python's parser reads the text after every token was checked; Python never evaluates the text.
"""

import ast
import keyword
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message

Kind = Literal["bit", "word"]
Value = bool | float | None
Inputs = Mapping[str, float | None]
"""The values read from the machine by name, before conversion to bits or words; a refused value is
None.
"""
MOST_CHARACTERS = 500
DEEPEST = 20
"""Largest number of nested levels of brackets and ``not`` in an expression."""
_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d+)?(?!\w))|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>==|!=|<=|>=|<|>|\(|\)|-)|(?P<odd>\S)|\Z)",
    re.ASCII,
)
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[float, float], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_WORDS = ("and", "or", "not", "latch")
_WANTED = {"bit": message("wanted-bit"), "word": message("wanted-word")}


@dataclass(slots=True)
class Memory:
    last: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression; ``names`` are the inputs that the expression reads."""

    kind: Kind
    names: frozenset[str]
    value: Callable[[Inputs, Memory], Value]


def parse_expression(text: str, kinds: Mapping[str, Kind], where: str) -> Expression:
    """Return the expression of a text. ``kinds`` are the inputs that the text may use; ``where`` is
    the field of the survey file.

    Raises UsageError with the position of the first invalid character.
    """
    if len(text) > MOST_CHARACTERS:
        most = message("characters-most", count=MOST_CHARACTERS)
        raise UsageError(where, expected=most, found=str(len(text)))
    return _Text(text, kinds, where).expression()


class _Text:
    def __init__(self, text: str, kinds: Mapping[str, Kind], where: str) -> None:
        self._text, self._kinds, self._where = text, kinds, where

    def expression(self) -> Expression:
        source = self._source().rstrip()
        self._begin = len(source) - len(source.lstrip())
        try:
            tree = ast.parse(source.lstrip(), mode="eval")
        except SyntaxError as error:
            # Python reports no position for a part that is missing at the end
            at = self._begin + error.offset - 1 if error.offset else len(source)
            raise self._misplaced(at) from None
        return self._built(tree.body)

    def _source(self) -> str:
        source, before, levels = [" "] * len(self._text), "", 0
        opened: list[int] = []
        for token in _TOKEN.finditer(self._text):
            word, at = token[token.lastgroup or 0], token.start(token.lastgroup or 0)
            if token.lastgroup == "odd":
                raise self._misplaced(at)
            if token.lastgroup == "name" and word not in (*self._kinds, *_WORDS):
                raise self._refusal(message("one-of", names=sorted(self._kinds) or ["-"]), at)
            levels += word == "not" or (word == "(" and before != "latch")
            if levels > DEEPEST:
                raise self._refusal(message("levels-at-most", count=DEEPEST), at)
            if word == ")" and not opened:
                raise self._refusal(message("expression-goes-on"), at)
            opened = (
                [*opened, levels] if word == "(" else opened[: len(opened) - (word == ")")]
            )
            levels = levels if word == "not" else (opened or [0])[-1]
            source[at : at + len(word)] = _as_python(word)
            before = word
        if opened:
            raise self._refusal(")", len(self._text))
        return "".join(source)

    def _built(self, node: ast.expr) -> Expression:
        match node:
            case ast.BoolOp(op=op, values=values):
                sides = [self._of("bit", side) for side in values]
                return _several_bits(sides, decided_by=isinstance(op, ast.Or))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                inner = self._of("bit", operand)
                return Expression("bit", inner.names, lambda *read: _not(inner.value(*read)))
            case ast.Compare(left=left, ops=[sign], comparators=[right]):
                return _compared(self._of("word", left), self._of("word", right), sign)
            case ast.UnaryOp(
                op=ast.USub(), operand=ast.Constant(value=int() | float() as figure)
            ):
                return _figure(-figure)
            case ast.Constant(value=int() | float() as figure):
                return _figure(figure)
            case ast.Call(func=ast.Name(id="latch"), args=[ast.Name() as held], keywords=[]):
                return _latch(self._name(held), self._of("word", held))
            case ast.Name() if self._name(node) not in _WORDS:
                name = self._name(node)
                return _bit(name) if self._kinds[name] == "bit" else _word(name)
            case (
                ast.Compare(comparators=[left, *_])
                | ast.BinOp(left=left)
                | ast.Call(func=left)
            ):
                raise self._misplaced(self._end(left))
            case ast.UnaryOp(operand=left):
                raise self._refusal(message("a-number"), self._at(left))
        raise self._misplaced(self._end(node))

    def _of(self, kind: Kind, node: ast.expr) -> Expression:
        found = self._built(node)
        if found.kind != kind:
            raise self._refusal(_WANTED[kind], self._at(node))
        return found

    def _name(self, node: ast.Name) -> str:
        return self._text[self._at(node) : self._end(node)]

    def _at(self, node: ast.expr) -> int:
        return self._begin + node.col_offset

    def _end(self, node: ast.expr) -> int:
        return self._begin + (node.end_col_offset or 0)

    def _misplaced(self, at: int) -> UsageError:
        before = self._text[:at].rstrip()
        ended = before.endswith(")") or (
            before[-1:].isalnum() and not re.search(r"\b(and|or|not)\Z", before)
        )
        return self._refusal(
            message("expression-goes-on" if ended else "expression-begins"), at
        )

    def _refusal(self, expected: Words, at: int) -> UsageError:
        token = _TOKEN.match(self._text, at)
        word = token[token.lastgroup] if token and token.lastgroup else ""
        if not word:
            found = message("end-of-text", text=repr(self._text))
        else:
            place = self._text.index(word, at) + 1
            found = message(
                "at-character", token=repr(word), place=place, text=repr(self._text)
            )
        return UsageError(self._where, expected=expected, found=found)


def _as_python(word: str) -> str:
    """Return a token of the same length that Python parses as a name or a number: the name of an
    input may be a Python keyword, and a number may begin with zeros.
    """
    if keyword.iskeyword(word) and word not in _WORDS:
        return word.swapcase()
    return re.sub(r"^0+(?=\d)", "", word).rjust(len(word))


def _figure(figure: float) -> Expression:
    return Expression("word", frozenset(), lambda _inputs, _memory: float(figure))


def _word(name: str) -> Expression:
    return Expression("word", frozenset([name]), lambda inputs, _: inputs[name])


def _bit(name: str) -> Expression:
    def value(inputs: Inputs, _: Memory) -> Value:
        return None if inputs[name] is None else bool(inputs[name])

    return Expression("bit", frozenset([name]), value)


def _latch(name: str, word: Expression) -> Expression:
    def kept(inputs: Inputs, memory: Memory) -> Value:
        now = inputs[name]
        if now:
            memory.last[name] = now
        return memory.last.get(name, now)

    return Expression("word", word.names, kept)


def _several_bits(sides: Sequence[Expression], *, decided_by: bool) -> Expression:
    """Return the ``and`` or ``or`` of several bits. A bit equal to ``decided_by`` decides the
    result, even if another bit is unknown. Every operand is evaluated, because its latches must be
    updated.
    """

    def value(inputs: Inputs, memory: Memory) -> Value:
        values = [side.value(inputs, memory) for side in sides]
        if decided_by in values:
            return decided_by
        return None if None in values else not decided_by

    return Expression("bit", frozenset().union(*(side.names for side in sides)), value)


def _compared(left: Expression, right: Expression, sign: ast.cmpop) -> Expression:
    holds = _COMPARISONS[type(sign)]

    def value(inputs: Inputs, memory: Memory) -> Value:
        one, other = left.value(inputs, memory), right.value(inputs, memory)
        return None if one is None or other is None else holds(one, other)

    return Expression("bit", left.names | right.names, value)


def _not(value: Value) -> Value:
    return None if value is None else not value
