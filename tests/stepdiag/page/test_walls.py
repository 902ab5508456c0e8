"""An attacker inside a confined process: what it reaches of its recorder, of files, and of the
network, by every version of Landlock.

Another process stands for the recorder, a listener of TCP and UDP for the PLC. The attack goes by
the C library, as shellcode would.
"""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from stepdiag.page.app import Page, create_app
from stepdiag.page.messages import PageSettings
from stepdiag.texts.texts import LANGUAGES, catalogue
from stepdiag.walls.confine import OPEN
from testkit.browsing import visit

ATTACK = Path(__file__).parents[2] / "lib/testkit/hostile/attack.py"
VERSIONS = (0, 1, 2, 3, 4, 6, 99)
"""Masks of the kernel's Landlock; 99 is as it is, 0 a kernel without it."""


@pytest.fixture
def recorder():
    with subprocess.Popen(
        [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, text=True
    ) as process:
        yield process
        assert process.poll() is None, "the recorder lives"
        process.communicate("\n", timeout=60)


@pytest.fixture
def plc():
    with (
        socket.create_server(("127.0.0.1", 0)) as tcp,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
    ):
        udp.bind(tcp.getsockname())
        for each in (tcp, udp):
            each.setblocking(False)
        yield tcp, udp


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("walls", ["page", "opcua", "mqtt"])
def test_nothing_of_the_attack_succeeds(walls, version, recorder, plc, tmp_path):
    logs = tmp_path / "survey"
    logs.mkdir()
    (logs / "0001.mcap").write_bytes(b"a log" * 100)
    (tmp_path / "secret").write_text("a secret", encoding="utf-8")
    before = state(recorder.pid)
    port = plc[0].getsockname()[1]
    command = [
        sys.executable,
        str(ATTACK),
        walls,
        str(version),
        str(recorder.pid),
        str(port),
        str(logs),
        str(tmp_path / "secret"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["tried"] >= 30
    allowed = {"reads the log"} | (READING if version == 0 else set())
    assert set(found["succeeded"]) == allowed | (NETWORK if walls == "mqtt" else set()) | (
        TCP if walls == "mqtt" and version < 4 else set()
    )
    assert set(found["open"]) == open_to(walls, version)
    assert (logs / "0001.mcap").read_bytes() == b"a log" * 100
    assert [path.name for path in logs.iterdir()] == ["0001.mcap"]
    assert state(recorder.pid) == before
    if walls != "mqtt":
        for each in plc:
            with pytest.raises(BlockingIOError):
                each.recvfrom(100) if each is plc[1] else each.accept()


def test_the_page_names_what_is_open(tmp_path):
    """In both languages, and empty where the kernel shuts all."""
    settings = PageSettings(folder=str(tmp_path), token="")
    page = Page(SimpleNamespace(say_guesses=lambda *_: None), settings)
    application = create_app(page, None, settings)
    assert json.loads(visit(application, "/about.json", "127.0.0.1")[1])["open"] == []
    page.still_open = tuple(OPEN)
    assert json.loads(visit(application, "/about.json", "127.0.0.1")[1])["open"] == list(OPEN)
    for language in LANGUAGES:
        assert {f"open_{each.lower().replace(' ', '_')}" for each in OPEN} <= catalogue(
            "page", language
        ).keys()


READING = {"reads a secret", "reads /etc/passwd", "its memory as a file"}
NETWORK = {
    "UDP to the PLC",
    "a unix socket",
    "a netlink socket",
    "a raw socket",
    "a packet socket",
    "a vsock",
}
"""What finds a host by its name needs sockets; the unit of what publishes shuts the rest
(`test_systemd_unit`)."""
TCP = {"TCP to the PLC", "a listening port"}


def open_to(walls, version):
    """Return what must be named."""
    reading = {"reading the disk and the memory of its account"} if version < 1 else set()
    network = (
        {"UDP and other sockets"}
        | ({"TCP"} if version < 4 else set())
        | ({"abstract sockets"} if version < 6 else set())
    )
    return reading | (network if walls == "mqtt" else set())


def state(pid):
    """Return what an attacker could have changed of a process: whether it runs, its limits,
    priority, processors and policy."""
    status = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    limits = Path(f"/proc/{pid}/limits").read_text()
    return (
        status[0] == "T",
        status[16],
        limits,
        sorted(os.sched_getaffinity(pid)),
        os.sched_getscheduler(pid),
    )
