"""Findings, refusals and the lines of the terminal are made of messages: a text of an error is a
name, a value or a path."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from stepdiag.texts.patterns import sentences

ROOT = Path(__file__).parents[3]
FLOORS = ("daq", "solver", "exporters", "stepdiag")
NAMES = ("--", "stepdiag ", "fourdof ", "service ", "4-DOF head")
"""Beginnings of options, commands and names of more than one word."""
PRINTED = {"echo", "prompt", "confirm", "working", "counted", "asked"}
MADE_BY = {
    "require",
    "UsageError",
    "DataError",
    "DeviceError",
    "SafetyError",
    "refuse",
    "finding",
    "Finding",
    *PRINTED,
}
SENTENCE = re.compile(
    r"[A-Za-z]{2,} "
    r"[a-z]{2,}|^(none|nothing|both|neither|silence|more|fewer|others|another|damaged)$"
)


def sentences_of(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and text of every argument of a finding or an error that is a sentence and no
    message, or a variable that holds one."""
    for scope in (
        each
        for each in ast.walk(tree)
        if isinstance(each, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef)
    ):
        held = dict(_assigned(scope))
        for call in (
            each
            for each in ast.walk(scope)
            if isinstance(each, ast.Call) and _name(each.func) in MADE_BY
        ):
            for argument in (*call.args, *(keyword.value for keyword in call.keywords)):
                value = (
                    held.get(argument.id, argument)
                    if isinstance(argument, ast.Name)
                    else argument
                )
                yield from (
                    (value.lineno, text)
                    for text in _texts(value)
                    if SENTENCE.search(text) and not text.startswith(NAMES)
                )


def _assigned(scope: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Yield name and value of every assignment to a variable."""
    for node in ast.walk(scope):
        match node:
            case (
                ast.Assign(targets=[ast.Name(id=name)], value=value)
                | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
            ):
                yield name, value


def _texts(node: ast.expr) -> Iterator[str]:
    """Yield the texts that an expression may give, not those of a call, of a comparison or of a
    key."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(
                part.value
                if isinstance(part, ast.Constant) and isinstance(part.value, str)
                else "X"
                for part in parts
            )
        case ast.IfExp(body=first, orelse=second):
            yield from (text for part in (first, second) for text in _texts(part))
        case ast.BinOp(left=first, right=second):
            yield from (text for part in (first, second) for text in _texts(part))
        case ast.BoolOp(values=parts):
            yield from (text for part in parts for text in _texts(part))


def _name(function: ast.expr) -> str:
    return (
        function.id
        if isinstance(function, ast.Name)
        else function.attr
        if isinstance(function, ast.Attribute)
        else ""
    )


def test_no_finding_and_no_refusal_is_a_plain_sentence() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for floor in FLOORS
        for path in sorted((ROOT / floor).rglob("*.py"))
        if "virtual" not in path.parts
        for line, text in sentences_of(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def test_the_search_finds_a_plain_sentence() -> None:
    """In a constant, in a composed text and behind a condition."""
    source = (
        'DataError("a", expected=f"at most {n} rows", found=str(n))\nrefuse("an object" if a '
        'else "b", 1)\nfinding("info", message("a-b"))'
    )
    assert [line for line, _ in sentences_of(ast.parse(source))] == [1, 2]


def test_every_key_of_the_catalogue_is_used() -> None:
    """A key that no product code writes out is deleted; those of the operating system are made from
    its number (`system_words`)."""
    paths = (
        path
        for floor in ("daq", "solver", "exporters", "stepdiag")
        for path in (ROOT / floor).rglob("*.py")
    )
    source = "".join(path.read_text(encoding="utf-8") for path in paths)
    used = set(re.findall(r'"([a-z0-9]+(?:-[a-z0-9]+)*(?:\.[a-z0-9-]+)?)"', source))
    assert [key for key in sentences() if key not in used and not key.startswith("os-")] == []


PARSERS = (
    "daq/formats/expressions.py",
    "daq/log/codec.py",
    "exporters/fanuc/punch.py",
    "stepdiag/certificate/custody.py",
    "stepdiag/cli/service.py",
    "stepdiag/daemon/installation.py",
)
"""Readers of texts that are no message: tokens, blocks of a control, nodes of XML, unit files, and
logs of before messages were values."""


def decided_by_words(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and source of every comparison, membership test and search in the ``text`` or
    ``detail`` of a message."""
    for node in ast.walk(tree):
        asked: list[ast.expr] = []
        if isinstance(node, ast.Compare):
            asked = [node.left, *node.comparators]
        elif isinstance(node, ast.Call):
            asked = (
                [*node.args]
                if _name(node.func) in {"match", "search", "fullmatch", "findall"}
                else []
            )
            asked += [node.func.value] if isinstance(node.func, ast.Attribute) else []
        words = [
            each
            for each in asked
            if isinstance(each, ast.Attribute) and each.attr in {"text", "detail"}
        ]
        yield from ((node.lineno, ast.unparse(each)) for each in words)


def test_no_decision_reads_the_words_of_a_message() -> None:
    """The key and the arguments of a message decide; its words are for its reader."""
    found = [
        f"{path.relative_to(ROOT)}:{line}: {source}"
        for floor in FLOORS
        for path in sorted((ROOT / floor).rglob("*.py"))
        if "virtual" not in path.parts and not str(path.relative_to(ROOT)).startswith(PARSERS)
        for line, source in decided_by_words(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def test_the_search_finds_a_decision_by_words() -> None:
    source = (
        'a = found.text == "x"\nb = "x" in link.detail\nc = re.search("x", one.text)\nd = '
        'one.text.startswith("x")\ne = f(one.text)'
    )
    assert [line for line, _ in decided_by_words(ast.parse(source))] == [1, 2, 3, 4]
