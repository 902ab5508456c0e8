"""One change before the tests: a child process in which the program is another one.

Most changes are within a function. The tests are collected once; each child is forked after that,
gives the live function its changed code and runs the tests that reach it until one fails. What is
outside of functions (a constant, a default) changes what others import: there the child is forked
before anything is imported, and imports the changed file in place of the one on disk.
"""

import ast
import gc
import os
import resource
import signal
import time
from collections.abc import Callable, Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, FunctionType
from typing import NamedTuple

import pytest
from mutation import Mutation
from reach import QUICK, Map

MEMORY = 8 << 30
UNTOUCHED = 9
NO_TESTS = 5
SURVIVED = {0, NO_TESTS}


class Question(NamedTuple):
    """A change, the tests that are asked, what they take unchanged, and whether it is within a
    function."""

    mutation: Mutation
    tests: list[str]
    seconds: float
    within: bool


def function(source: str, line: int) -> range | None:
    """Return the lines of the innermost function around a line; None outside of one, and in one
    whose value is kept from call to call."""
    found = None
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.body[
            0
        ].lineno <= line <= (node.end_lineno or 0):
            kept = any(
                "cache" in ast.unparse(one) and "property" not in ast.unparse(one)
                for one in node.decorator_list
            )
            found = None if kept else range(node.body[0].lineno, (node.end_lineno or 0) + 1)
    return found


def question(root: Path, mutation: Mutation, reach: Map) -> Question:
    """Choose who is asked: the tests that run the line or, where it runs when the file is imported,
    all that touch the file."""
    lines = function((root / mutation.path).read_text(encoding="utf-8"), mutation.line)
    tests = reach.tests(mutation.path, lines)
    return Question(
        mutation, tests, sum(reach.seconds[test] for test in tests), lines is not None
    )


def _functions(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of every function of a module that is not within another function."""
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            if inner.co_flags & 1:  # CO_OPTIMIZED: a function, not the body of a class
                yield inner
            else:
                yield from _functions(inner)


def exchange(path: Path, source: str) -> int:
    """Give the live functions of a file the code that they have in ``source``. Returns how many
    were another."""
    old, new = (
        [*_functions(compile(text, str(path), "exec"))]
        for text in (path.read_text(encoding="utf-8"), source)
    )
    changed = {
        (before.co_qualname, before.co_firstlineno): after
        for before, after in zip(old, new, strict=True)
        if not _same(before, after)
    }
    count = 0
    gc.unfreeze()  # what is frozen (tests/conftest.py) is not among the objects
    for live in gc.get_objects():
        if isinstance(live, FunctionType) and live.__code__.co_filename.endswith(path.name):
            after = changed.get((live.__code__.co_qualname, live.__code__.co_firstlineno))
            if after is not None and path.samefile(live.__code__.co_filename):
                live.__code__ = after
                count += 1
    return count


def _same(before: CodeType, after: CodeType) -> bool:
    plain = [
        [one for one in code.co_consts if not isinstance(one, CodeType)]
        for code in (before, after)
    ]
    inner = [
        [one for one in code.co_consts if isinstance(one, CodeType)]
        for code in (before, after)
    ]
    alike = (
        before.co_code == after.co_code
        and repr(plain[0]) == repr(plain[1])
        and before.co_names == after.co_names
    )
    return alike and len(inner[0]) == len(inner[1]) and all(map(_same, *inner))


def change(path: Path, source: str) -> None:
    """Have this process import other code than the file holds, under whatever name it is
    imported."""
    code, honest = (
        compile(source, str(path), "exec", dont_inherit=True),
        SourceFileLoader.get_code,
    )

    def get_code(loader: SourceFileLoader, fullname: str) -> CodeType | None:
        mine = loader.path.endswith(path.name) and path.samefile(loader.path)
        return code if mine else honest(loader, fullname)

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]


class Selected:
    """Plugin of pytest: these tests, in this order."""

    def __init__(self, tests: list[str]) -> None:
        self.order = {test: place for place, test in enumerate(tests)}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self.order),
            key=lambda item: self.order[item.nodeid],
        )


def anew(root: Path, asked: Question) -> int:
    """In a child in which nothing is imported yet: return what pytest says of the changed file."""
    change(root / asked.mutation.path, asked.mutation.apply(root))
    files = sorted({test.partition("::")[0] for test in asked.tests})
    return int(
        pytest.main([*QUICK, "-x", "--tb=no", *files], plugins=[Selected(asked.tests)])
    )


def at_once(session: pytest.Session, root: Path, asked: Question) -> int:
    """In a child of a session that has collected: return what the tests say of the changed
    function."""
    if not exchange(root / asked.mutation.path, asked.mutation.apply(root)):
        return UNTOUCHED
    session.config.pluginmanager.unregister(name="terminalreporter")
    known = {item.nodeid: item for item in session.items}
    items = [known[test] for test in asked.tests if test in known]
    if not items:
        return NO_TESTS
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return 1
    return 0


Told = Callable[[Question, str, float], None]


class Trials:
    """Some children at a time; every outcome is told as it comes."""

    def __init__(self, root: Path, jobs: int, told: Told) -> None:
        self._root, self._jobs, self._told = root, jobs, told
        self._open: dict[int, tuple[Question, float]] = {}

    def run(self, questions: list[Question], answer: Callable[[Question], int]) -> None:
        """Ask all of them."""
        for asked in questions:
            while len(self._open) >= self._jobs:
                self._wait()
            self._open[self._start(asked, answer)] = (asked, time.monotonic())
        while self._open:
            self._wait()

    def _start(self, asked: Question, answer: Callable[[Question], int]) -> int:
        if child := os.fork():
            return child
        code = 3
        try:
            os.setpgrp()
            os.chdir(self._root)
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)
            seconds = int(20 + 4 * asked.seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            code = answer(asked)
        finally:
            os._exit(code)

    def _wait(self) -> None:
        while True:
            child, status = os.waitpid(-1, os.WNOHANG)
            if child in self._open:
                asked, began = self._open.pop(child)
                code = os.waitstatus_to_exitcode(status)
                word = (
                    "survived"
                    if code in SURVIVED
                    else "timeout"
                    if code < 0
                    else "untouched"
                    if code == UNTOUCHED
                    else "killed"
                )
                self._told(asked, word, time.monotonic() - began)
                return
            for child, (asked, began) in self._open.items():
                if (
                    time.monotonic() - began > 300 + 40 * asked.seconds
                ):  # it waits for something, and for ever
                    os.killpg(child, signal.SIGKILL)
            time.sleep(0.02)


class Collected:
    """Plugin of pytest: where the tests would run, the changes are tried."""

    def __init__(self, root: Path, trials: Trials, questions: list[Question]) -> None:
        self._root, self._trials, self._questions = root, trials, questions

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if (
            session.testsfailed
        ):  # in every trial a test would have failed: as if each change were noticed
            os._exit(1)
        self._trials.run(self._questions, lambda asked: at_once(session, self._root, asked))
        return True


def ask(
    root: Path, tests: list[str], questions: list[Question], jobs: int, told: Told
) -> None:
    """Try the changes. Imports nothing of the program here."""
    trials, within = Trials(root, jobs, told), [asked for asked in questions if asked.within]
    if within and not (child := os.fork()):
        os.chdir(root)
        pytest.main([*QUICK, *tests], plugins=[Collected(root, trials, within)])
        os._exit(0)
    if within and os.waitpid(child, 0)[1]:
        raise SystemExit("some tests cannot be collected: nothing can be said of changes")
    trials.run(
        [asked for asked in questions if not asked.within], lambda asked: anew(root, asked)
    )
