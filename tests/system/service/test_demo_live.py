"""``stepdiag demo --live`` as a person uses it: the page, Enter, every key and the way out of what
it causes, the end."""

import json
import os
import signal
import subprocess
import sys
import tty
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.demo import files, operator
from stepdiag.demo.keys import Keyboard
from stepdiag.demo.live import END, GO, KEYS, live
from testkit.running.slaves import wait_until

pytestmark = pytest.mark.system


def until_stage(stream, stage):
    """Read the page's stream until it shows a stage."""
    for line in stream:
        if f'"stage":"{stage}"'.encode() in line:
            return
    raise AssertionError(f"the stream ended before {stage}")


def children_of(number: int) -> list[int]:
    """Return the processes that a process started and that still run."""
    return [
        int(child)
        for task in Path(f"/proc/{number}/task").iterdir()
        for child in (task / "children").read_text(encoding="ascii").split()
    ]


def runs(number: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        status = Path(f"/proc/{number}/status").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False
    return "State:\tZ" not in status


def test_a_killed_demo_leaves_nothing_running(tmp_path):
    """SIGKILL leaves the demo no last step: the kernel ends virtual machine and daemon with it."""
    command = (sys.executable, "-m", "stepdiag", "demo", "--out", str(tmp_path / "demo"))
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as demo:
        lines = [demo.stderr.readline() for _ in range(2)]
        children = children_of(demo.pid)
        demo.kill()
        demo.wait(timeout=120)
        wait_until(lambda: not any(runs(child) for child in children), 120.0)
    assert lines[0] == "starting\n"
    assert len(children) == 2


def test_the_demo_names_its_work_at_once_and_its_end_ends_what_it_started(tmp_path):
    """Piped there is no bar: a line stands for each setup. SIGTERM left the virtual machine and the
    daemon behind."""
    command = (sys.executable, "-m", "stepdiag", "demo", "--out", str(tmp_path / "demo"))
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as demo:
        lines = [demo.stderr.readline() for _ in range(2)]
        children = children_of(demo.pid)
        demo.terminate()
        assert demo.wait(timeout=120) == 128 + signal.SIGTERM
        rest = demo.stderr.read()
    assert lines == ["starting\n", "diagonal X-Y-Z- to X+Y+Z+ (ppp) out\n"]
    assert len(children) == 2
    assert not any(Path(f"/proc/{child}").exists() for child in children)
    assert "Traceback" not in rest


def test_a_hand_in_the_beam_is_seen_on_the_page(tmp_path):
    """Enter starts the first setup, a key cuts the beam, the page's own stream says so; afterwards
    nothing is left running."""
    command = (
        sys.executable,
        "-m",
        "stepdiag",
        "demo",
        "--live",
        "--no-browser",
        "--out",
        str(tmp_path / "demo"),
    )
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as demo:
        address = next(line for line in demo.stdout if line.startswith("The page: ")).split()[
            -1
        ]
        with urllib.request.urlopen(f"{address}/stream", timeout=200) as stream:
            demo.stdin.write("\n")
            demo.stdin.flush()
            until_stage(stream, "drive")
            demo.stdin.write("b")
            demo.stdin.flush()
            until_stage(stream, "trouble")
        said, _ = demo.communicate("q", timeout=200)
    assert "hold a hand into the beam" in said
    assert demo.returncode == 0
    assert list((tmp_path / "demo" / "demo" / "0001").glob("*.mcap*")), (
        "what was recorded stays"
    )


PRESSED = {
    "ppp": (
        "b",
        {"alarm_go_back", "alarm_beam", "alarm_count"},
        {"beam-lost", "stop-without-reading", "stop-doubtful"},
    ),
    "npp": ("k", set(), {"window-step", "count-slip", "count-step", "stop-unsteady"}),
    "pnp": (
        "u",
        {"alarm_laser"},
        {"samples-missing", "instrument-restart", "bytes-garbled", "stop-without-reading"},
    ),
    "ppn": (
        "p",
        {"alarm_plc"},
        {"stop-missed", "stop-lost", "stop-recovered", "pass-broken"},
    ),
    "linear-x": ("a", set(), {"conditions-held"}),
    "linear-y": ("s", set(), {"stop-missed", "stop-lost", "count-disagrees", "stop-skipped"}),
    "linear-z": ("r", {"alarm_machine"}, {"machine-alarm", "stop-again"}),
}
"""In which setup a key is pressed, one of the page's cards then (none where nothing blocks), and
one of the findings that tell of it."""


class Watching:
    """A person at a terminal: presses each key where `PRESSED` says so, on a pty, and Enter
    wherever a program is waited for."""

    def __init__(self, keyboard, hand):
        self.pressed = keyboard.pressed
        self.lines = []
        self.cards, self.codes = set(), set()
        self.ended = False
        self._hand = hand
        self._looking = ThreadPoolExecutor(1)
        self._looked = None

    def show(self, line):
        self.lines.append(line)

    def opened(self, address, _token):
        self._looked = self._looking.submit(self._look, address)

    def finish(self):
        """Raise what went wrong while looking."""
        self._looking.shutdown()
        self._looked.result()

    def _look(self, address):
        """Look at the page's stream until the survey is complete."""
        left, now = dict(PRESSED), {}
        try:
            with urllib.request.urlopen(f"{address}/stream", timeout=200) as stream:
                for line in stream:
                    if line.startswith(b"data: "):
                        now |= json.loads(line[6:])
                    if "phase" in now and "findings" in now and line.startswith(b"data: "):
                        self._see(now, left)
                    if now.get("phase") == "complete":
                        break
        finally:
            os.write(self._hand, END.encode())

    def _see(self, now, left):
        self.cards.add(now["lead"]["key"])
        self.codes |= {one["code"] for one in now["findings"]}
        if now["phase"] == "waiting-program":
            os.write(self._hand, GO.encode())
        elif (
            now["phase"] in ("waiting-stop", "dwelling")
            and now["expects_stop"] >= 1
            and now["expects_setup"] in left
        ):
            os.write(self._hand, left.pop(now["expects_setup"])[0].encode())


def test_every_key_is_told_and_the_survey_comes_to_its_end(tmp_path, monkeypatch):
    """Each fault is on the page, what is broken is driven again, and the files and the conclusion
    are there at the end."""
    monkeypatch.setattr(files, "INCREMENTS", 1)
    monkeypatch.setattr(operator, "SETTLED_S", 1.0)  # six times what is missing is asked for
    for key, seconds in (
        ("u", 1.5),
        ("p", 3.0),
    ):  # as long as five and eight for the watched machine, which is five times as slow
        monkeypatch.setitem(KEYS, key, replace(KEYS[key], duration_s=seconds))
    hand, terminal = os.openpty()
    tty.setcbreak(terminal)
    with closing(os.fdopen(hand, "wb")), closing(os.fdopen(terminal, "rb")):
        person = Watching(Keyboard(terminal), hand)
        live(tmp_path / "demo", 1, person, files.FAST)
        person.finish()
    assert {key for key, _, _ in PRESSED.values()} == set(KEYS), "every key is pressed"
    assert [each.does for each in KEYS.values() if each.does not in person.lines] == []
    assert [
        key for key, cards, _ in PRESSED.values() if cards and not cards & person.cards
    ] == []
    assert [
        (key, sorted(person.codes))
        for key, _, codes in PRESSED.values()
        if not codes & person.codes
    ] == []
    folder = tmp_path / "demo" / "demo" / "0001"
    said = json.loads((folder / "conclusion.json").read_text(encoding="utf-8"))
    assert "sign test" in said["next_step"][0]["en"]
    assert {
        path.name
        for path in (folder / "exports").iterdir()
        if (path / "SHA256SUMS").is_file()
    } == {"siemens", "fanuc"}
