"""One change before the tests: a child process that imports the changed file in place of the one on disk."""

import ast
import os
import resource
import signal
import sys
import time
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

import pytest
from mutation import Mutation
from reach import QUICK, Map

BUDGET_S = 60.0  # of what the tests take unchanged: the slowest are left out beyond it
MEMORY = 8 << 30


def change(path: Path, source: str) -> None:
    """Have this process import other code than the file holds, under whatever name it is imported."""
    code, honest = compile(source, str(path), "exec", dont_inherit=True), SourceFileLoader.get_code

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
        items[:] = sorted((item for item in items if item.nodeid in self.order), key=lambda item: self.order[item.nodeid])


def function(source: str, line: int) -> range | None:
    """Return the lines of the innermost function around a line; None outside of one, and in one whose value is kept from call to call."""
    found = None
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.body[0].lineno <= line <= (node.end_lineno or 0):
            kept = any("cache" in ast.unparse(one) and "property" not in ast.unparse(one) for one in node.decorator_list)
            found = None if kept else range(node.body[0].lineno, (node.end_lineno or 0) + 1)
    return found


def chosen(root: Path, mutation: Mutation, reach: Map) -> list[str]:
    """Return the tests to ask: those that run the line or, where it is run when the file is imported, all that touch the file."""
    lines = function((root / mutation.path).read_text(encoding="utf-8"), mutation.line)
    tests, spent, taken = reach.tests(mutation.path, lines), 0.0, []
    for test in tests:
        spent += reach.seconds[test]
        if taken and spent > BUDGET_S:
            break
        taken.append(test)
    return taken


def start(root: Path, mutation: Mutation, tests: list[str], seconds: float, output: Path) -> int:
    """Start a child that runs these tests until one fails, and return its process id. Its exit code is pytest's."""
    child = os.fork()
    if child:
        return child
    os.setpgrp()
    os.chdir(root)
    output.parent.mkdir(parents=True, exist_ok=True)
    target = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(target, 1)
    os.dup2(target, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(20 + 4 * seconds), int(25 + 4 * seconds)))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    change(root / mutation.path, mutation.apply(root))
    files = sorted({test.partition("::")[0] for test in tests})
    code = 3
    try:
        code = int(pytest.main([*QUICK, "-x", "--tb=line", *files], plugins=[Selected(tests)]))
    finally:
        sys.stdout.flush()
        os._exit(code)


class Running:
    """The children at work."""

    def __init__(self) -> None:
        self._open: dict[int, tuple[Mutation, float, float]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def add(self, child: int, mutation: Mutation, limit_s: float) -> None:
        """Take note of a child."""
        self._open[child] = (mutation, time.monotonic(), limit_s)

    def wait(self) -> tuple[Mutation, str, float]:
        """Wait for one to end, or end one that is over its time. Returns the change, how it went, and the seconds."""
        while True:
            child, status = os.waitpid(-1, os.WNOHANG)
            if child in self._open:
                mutation, began, _ = self._open.pop(child)
                code = os.waitstatus_to_exitcode(status)
                word = {0: "survived", 5: "survived"}.get(code, "timeout" if code in {-signal.SIGXCPU, -signal.SIGKILL} else "killed")
                return mutation, word, time.monotonic() - began
            for child, (_, began, limit_s) in self._open.items():
                if time.monotonic() - began > limit_s:
                    os.killpg(child, signal.SIGKILL)
            time.sleep(0.05)
