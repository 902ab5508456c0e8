"""What somebody on the network does to the page while a pass is recorded: every stop is captured,
and the log stays readable."""

import os
import resource
import signal
import socket
import threading
import time
import urllib.request
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from stepdiag.virtual.base.reserved import reserved_port
from testkit.played import served
from testkit.running.hall import daemon, hall, until

pytestmark = pytest.mark.system

IDLE, STREAMS = 1100, 500
GARBAGE = (
    b"GET /stream HTTP/1.1\r\nHost: x\r\n\r\n",
    b"\x16\x03\x01" * 400,
    b"POST /command HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n",
)


def many(place, port, count, words):
    """Open connections that say something, or nothing, and are never read; those that are refused
    count as well."""
    for _ in range(count):
        with suppress(OSError):
            one = place.enter_context(
                socket.create_connection(("127.0.0.1", port), timeout=0.2)
            )
            one.sendall(words)


@contextmanager
def flooded(port):
    """Keep idle connections and streams open, and hammer with garbage, while the block runs."""
    stop = threading.Event()

    def hammer():
        while not stop.wait(0.005):
            for words in GARBAGE:
                with (
                    suppress(OSError),
                    socket.create_connection(("127.0.0.1", port), timeout=0.2) as one,
                ):
                    one.sendall(words)

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, hard), hard))
    worker = threading.Thread(target=hammer)
    try:
        with ExitStack() as place:
            many(place, port, IDLE, b"GET / HT")
            many(place, port, STREAMS, b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
            worker.start()
            yield
            stop.set()
            worker.join()
    finally:
        stop.set()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_every_stop_is_captured_whatever_happens_to_the_page(tmp_path):
    """Idle connections by the thousand, hundreds of streams, garbage without end: 26 of 26 stops,
    and a log that a person can read."""
    port = reserved_port()
    with (
        hall(
            tmp_path,
            setups=("ppp", "npp"),
            n=4,
            handshake=True,
            dwell=2.5,
            page=True,
            page_port=port,
        ) as place,
        daemon(place.survey) as process,
    ):
        with flooded(port):
            place.start_setups()
            said = until(process, "survey-complete")
        assert sum(one["event"] == "stop" for one in said) == 26
        assert len(said) < 200
        assert answers_soon(port)


def answers_soon(port):
    """Return whether the page answers once those who kept it busy have gone."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        with (
            suppress(OSError),
            urllib.request.urlopen(
                f"http://127.0.0.1:{port}/about.json", timeout=10
            ) as answer,
        ):
            return answer.status == 200
    return False


def test_a_page_that_dies_is_started_again_and_the_recording_does_not_notice(tmp_path):
    """kill -9 of the page's process in the middle of a pass: every stop is there, and the page
    answers again."""
    port = reserved_port()
    with (
        hall(
            tmp_path,
            setups=("ppp",),
            n=2,
            handshake=True,
            dwell=0.5,
            page=True,
            page_port=port,
        ) as place,
        daemon(place.survey) as process,
    ):
        while not (pid := page_process(process.process.pid)):
            time.sleep(0.05)
        os.kill(pid, signal.SIGKILL)
        place.start_setups()
        said = until(process, "survey-complete")
        assert sum(one["event"] == "stop" for one in said) == 7
        assert any(one["event"] == "page-ended" for one in said), said
        assert answers_soon(port)


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.4])
def test_a_page_that_dies_while_it_starts_comes_back_too(tmp_path, after_s):
    """Its pipe may break before or after the first word over it; the line to it is closed only
    once."""
    with served(tmp_path) as page:
        while not (pid := page_process(os.getpid())):
            time.sleep(0.005)
        time.sleep(after_s)
        os.kill(pid, signal.SIGKILL)
        assert answers_soon(int(page.address.rpartition(":")[2]))


def page_process(parent):
    """Return the page's process of a daemon, 0 while there is none."""
    with suppress(OSError):  # one that ends while it is looked at
        for child in Path(f"/proc/{parent}/task").glob("*/children"):
            for pid in child.read_text().split():
                if b"stepdiag.page.process" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    return int(pid)
    return 0
