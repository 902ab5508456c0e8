"""What is tried again, and what is not: a test kit that forgave too much would prove nothing."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest

from testkit.running.steady import ATTEMPTS, watched

pytestmark = pytest.mark.system

INNER = """
import ctypes, time
from pathlib import Path
import pytest

def stand_still(seconds):
    "No thread of this process runs meanwhile: the call keeps the interpreter."
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))

@pytest.mark.{mark}
def test_it(tmp_path):
    with Path({count!r}).open("a") as counted:
        print(tmp_path, file=counted)
    folders = Path({count!r}).read_text().splitlines()
    stand_still({stands_still_s})
    assert len(folders) == len(set(folders)) == {right_at}
"""
"""A test as pytest runs it: it is right at its n-th attempt, each in a folder of its own."""


def attempts_of(folder, *, mark, stands_still_s, right_at, rules=""):
    """Return how often a test was tried, what pytest made of it, and what its record says."""
    counted = folder / "counted"
    (folder / "test_inner.py").write_text(
        INNER.format(
            mark=mark, count=str(counted), stands_still_s=stands_still_s, right_at=right_at
        )
    )
    (folder / "conftest.py").write_text(
        f"import testkit.running.steady as steady\n{rules}\npytest_runtest_protocol = "
        "steady.run_steadily\n"
    )
    (folder / "pytest.ini").write_text(
        "[pytest]\njunit_logging = system-out\nmarkers =\n    impatient\n    patient\n"
    )
    command = [
        sys.executable,
        "-m",
        "pytest",
        "--quiet",
        "-p",
        "no:cacheprovider",
        "--junit-xml=record.xml",
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(sys.modules["testkit"].__path__[0]).parent),
    }
    done = subprocess.run(
        command, check=False, cwd=folder, capture_output=True, env=environment, timeout=120
    )
    return (
        len(counted.read_text().splitlines()),
        done.returncode,
        (folder / "record.xml").read_text().count("once more"),
    )


def test_a_failure_while_everything_stood_still_is_tried_again_in_another_folder_and_recorded(
    tmp_path,
):
    assert attempts_of(tmp_path, mark="patient", stands_still_s=0.5, right_at=2) == (2, 0, 1)


def test_one_that_fails_every_time_has_failed(tmp_path):
    assert attempts_of(tmp_path, mark="patient", stands_still_s=0.5, right_at=99) == (
        ATTEMPTS,
        1,
        ATTEMPTS - 1,
    )


def test_one_that_fails_where_everything_went_on_has_failed(tmp_path):
    rules = "steady.SPARE_S = 60.0"  # a busy computer may stand still at this moment
    assert attempts_of(
        tmp_path, mark="patient", stands_still_s=0.5, right_at=2, rules=rules
    ) == (
        1,
        1,
        0,
    )


def test_a_machine_that_does_not_wait_can_spare_less(tmp_path):
    rules = "steady.SPARE_S = 60.0"
    assert attempts_of(
        tmp_path, mark="impatient", stands_still_s=0.1, right_at=2, rules=rules
    )[:2] == (2, 0)


@contextmanager
def slow_line():
    """Open a line that brings every byte half a second late, to a process that goes on."""
    taken, writes = os.pipe()
    reads, brings = os.pipe()

    def bring():
        while byte := os.read(taken, 1):
            time.sleep(0.5)
            os.write(brings, byte)

    worker = Thread(target=bring)
    worker.start()
    try:
        yield writes, reads
    finally:
        os.close(writes)
        worker.join()
        for end in (taken, reads, brings):
            os.close(end)


def test_a_line_that_stood_still_where_the_processors_went_on_is_a_standstill(monkeypatch):
    monkeypatch.setattr("testkit.running.steady.pty_line", slow_line)
    with watched() as standstill:
        time.sleep(0.1)
    assert standstill.worst_s >= 0.5
