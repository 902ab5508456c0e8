"""Which test reaches which line, and how long it takes: the tests, run once with coverage that
knows the test."""

import json
import os
import time
from pathlib import Path
from typing import Any

import coverage
import pytest

QUICK = [
    "-q",
    "--no-header",
    "-p",
    "no:cacheprovider",
    "--hypothesis-profile",
    "mutants",
    "-m",
    "not system and not page and not control and not partner",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",  # hypothesis is there before pytest asks for it
]


class Reach:
    """Plugin of pytest: every test, and every fixture that several tests share, is a context of its
    own."""

    def __init__(self, cover: coverage.Coverage) -> None:
        self.cover, self.seconds, self.shared = cover, {}, {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        self.cover.switch_context(item.nodeid)
        known = getattr(item, "_fixtureinfo", None)
        wide = (
            [
                one
                for several in known.name2fixturedefs.values()
                for one in several
                if one.scope != "function"
            ]
            if known
            else []
        )
        self.shared[item.nodeid] = [f"fixture {one.baseid} {one.argname}" for one in wide]
        start = time.process_time()
        try:
            return (yield)
        finally:
            self.seconds[item.nodeid] = time.process_time() - start

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Any:
        if fixturedef.scope == "function":
            return (yield)
        self.cover.switch_context(f"fixture {fixturedef.baseid} {fixturedef.argname}")
        try:
            return (yield)
        finally:
            self.cover.switch_context(
                request._pyfuncitem.nodeid if hasattr(request, "_pyfuncitem") else ""
            )


def record(root: Path, tests: list[str], sources: list[str], target: Path) -> int:
    """Run the tests and write what they reach to ``target``. Returns pytest's exit code. Changes
    this process: call it in a child."""
    os.chdir(root)
    cover = coverage.Coverage(
        data_file=None, source=sources, config_file=False, messages=False
    )
    plugin = Reach(cover)
    cover.start()
    code = pytest.main([*QUICK, *tests], plugins=[plugin])
    cover.stop()
    data, files = cover.get_data(), {}
    for name in data.measured_files():
        told = data.contexts_by_lineno(name)
        path = str(Path(name).resolve().relative_to(root))
        files[path] = {
            str(line): sorted(context for context in contexts if context)
            for line, contexts in told.items()
        }
    reached = {"seconds": plugin.seconds, "shared": plugin.shared, "files": files}
    target.write_text(json.dumps(reached), encoding="utf-8")
    return int(code)


class Map:
    """Which tests are asked about a line."""

    def __init__(self, targets: list[Path]) -> None:
        self.seconds: dict[str, float] = {}
        self._files: dict[str, dict[str, set[str]]] = {}
        self._users: dict[str, list[str]] = {}
        for target in targets:
            told = json.loads(target.read_text(encoding="utf-8"))
            self.seconds |= told["seconds"]
            for path, lines in told["files"].items():
                known = self._files.setdefault(path, {})
                for line, contexts in lines.items():
                    known.setdefault(line, set()).update(contexts)
            for test, fixtures in told["shared"].items():
                for fixture in fixtures:
                    self._users.setdefault(fixture, []).append(test)

    def tests(self, path: str, lines: range | None) -> list[str]:
        """Return the tests that run one of these lines (None: any line of the file, all of its
        room, and all reference data of its floor: what a class states of its fields is read without
        a line of it being run).

        The reference data first, which are quick and compare everything, then those of the room,
        then those of the floor, each quick first.
        """
        told = self._files.get(path, {})
        contexts = {
            context
            for line, those in told.items()
            if lines is None or int(line) in lines
            for context in those
        }
        reached = {
            test for context in contexts for test in self._users.get(context, [context])
        } & self.seconds.keys()
        room, floor = f"tests/{Path(path).parent}/", f"tests/{Path(path).parts[0]}/"
        whole = f"{floor}references/"
        if lines is None:
            reached |= {test for test in self.seconds if test.startswith((room, whole))}
        return sorted(
            reached,
            key=lambda test: (
                not test.startswith(whole),
                not test.startswith(room),
                not test.startswith(floor),
                self.seconds[test],
                test,
            ),
        )
