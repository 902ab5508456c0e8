"""A laser's line, or a PLC, that says nothing but nonsense as fast as it can: the daemon lives,
hears the other, and ends when told to."""

import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from stepdiag.virtual.base.reserved import reserved_port
from testkit.examples import spread
from testkit.running.slaves import Pty, TcpServer, wait_until

pytestmark = pytest.mark.system

SURVEY = """
[survey]
name = "flood"
machine = "m"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[laser]
format = "{format}"
port = "{port}"
{more}
[plc]
host = "127.0.0.1"
port = {plc}
poll_hz = 50
[page]
port = {page}
"""
PATTERN = "[laser.line]\npattern = '(?P<position>.*),(?P<counter>.*)'"
RATE = 4_000_000
ENDS_S = 2.0
NOISE = random.Random(7).randbytes(1_000_000)
SHORTEST_LINES = b"x\n" * 500_000


@contextmanager
def recording(folder, format_, plc, more=""):
    """Run a daemon on a pty and a PLC; yields process, pty and the page's port."""
    line, page = Pty(), reserved_port()
    survey = folder / "flood.toml"
    survey.write_text(
        SURVEY.format(format=format_, port=line.name, plc=plc, page=page, more=more)
    )
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "stepdiag", "run", str(survey)], stderr=log
        )
        try:
            while b'"ready"' not in (folder / "log").read_bytes():
                assert process.poll() is None
                time.sleep(0.05)
            yield process, line, page
        finally:
            process.kill()
            process.wait()
            line.close()


@contextmanager
def flooding(line, noise):
    """Write noise to the line at `RATE` bytes a second."""
    stop = threading.Event()
    os.set_blocking(line.far, False)

    def write():
        began, sent = time.monotonic(), 0
        while not stop.is_set():
            if sent > RATE * (time.monotonic() - began):
                time.sleep(0.001)
            with suppress(BlockingIOError):
                sent += os.write(line.far, noise[sent % len(noise) :][:4096])

    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def memory_mb(process):
    """Return the resident memory of a process."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return next(
        int(line.split()[1]) / 1024
        for line in status.splitlines()
        if line.startswith("VmRSS")
    )


def answers(page):
    """Return whether the page has the daemon's answer: that there is no result yet."""
    try:
        urllib.request.urlopen(f"http://127.0.0.1:{page}/result.json", timeout=60)
    except urllib.error.HTTPError as told:
        return told.code == 404
    except OSError:
        return False


def computed_s(process):
    """Return the processor time of a process so far, all threads, no children; of one that has
    ended too, until it is waited for."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ends(process):
    """End the daemon; return its exit code.

    The promise is two seconds on a computer that has nothing else to do; on any computer it is as
    much computing, since whatever else wants the processor costs none. A daemon that goes on
    reading noise does not end at all.
    """
    before = computed_s(process)
    process.send_signal(signal.SIGTERM)
    wait_until(
        lambda: (
            os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        )
    )
    assert computed_s(process) - before < ENDS_S
    return process.wait(60)


@pytest.mark.impatient
@pytest.mark.parametrize(
    ("format_", "more", "noise"),
    spread(
        [("umd", "", NOISE), ("line", PATTERN, NOISE), ("line", PATTERN, SHORTEST_LINES)], 2
    ),
)
def test_noise_at_four_megabytes_a_second(tmp_path, format_, more, noise):
    """The machine goes on being polled, the page answers, memory stays, and SIGTERM works."""
    asked = []

    def plc(request):
        asked.append(request)
        count = int.from_bytes(request[3:5], "big")
        return bytes([request[0], 2 * count]) + len(asked).to_bytes(2, "big") * count

    server = TcpServer(plc)
    try:
        with (
            recording(tmp_path, format_, server.port, more) as (process, line, page),
            flooding(line, noise),
        ):
            wait_until(lambda: len(asked) > 5)
            time.sleep(1.5)
            before, heard = memory_mb(process), len(asked)
            time.sleep(3.0)
            wait_until(lambda: len(asked) - heard >= 15)
            assert answers(page)
            assert memory_mb(process) - before < 30
            assert ends(process) == 0
            assert (tmp_path / "log").stat().st_size < 20_000
    finally:
        server.stop()


@contextmanager
def hostile_plc():
    """Answer every request with something else: noise, half an answer, too much, another
    transaction, nothing."""
    listener = socket.create_server(("127.0.0.1", 0))
    dice = random.Random(3)
    asked = []

    def serve(connection):
        with connection, suppress(OSError):
            while request := connection.recv(300):
                asked.append(request)
                kinds = (
                    dice.randbytes(260),
                    request[:5],
                    dice.randbytes(200_000),
                    b"\0\0" + request[2:7] + b"\x03\xff" * 100,
                    b"",
                )
                connection.sendall(dice.choice(kinds))

    def accept():
        with suppress(OSError):
            while True:
                threading.Thread(
                    target=serve, args=(listener.accept()[0],), daemon=True
                ).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listener.getsockname()[1], asked
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


@pytest.mark.impatient
def test_a_hostile_plc_is_harmless(tmp_path):
    """Nothing of what it says is taken, nothing is written to it, the laser is heard, and the
    daemon ends when it is told to."""
    with (
        hostile_plc() as (port, asked),
        recording(tmp_path, "line", port, PATTERN) as (process, line, page),
    ):
        before = memory_mb(process)
        end = time.monotonic() + 5.0
        while time.monotonic() < end or len(asked) < 3:
            line.write(b"1.5,3\n")
            time.sleep(0.02)
        assert {request[7] for request in asked if len(request) > 7} <= {1, 2, 3, 4}
        assert answers(page)
        assert memory_mb(process) - before < 30
        assert ends(process) == 0
        assert b"Traceback" not in (tmp_path / "log").read_bytes()
