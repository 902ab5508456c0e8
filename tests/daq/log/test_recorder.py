"""The recorder: what it admits is what a replay will see, whatever the disk does."""

import errno
import os
import resource
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from stepdiag.base.messages import message
from stepdiag.daq.log.contents import open_log
from stepdiag.daq.log.part_file import PartFile
from stepdiag.daq.log.recorder import FLUSH_S, SYNC_S, Recorder, RecorderHealth
from stepdiag.daq.log.topics import Note, log_note
from stepdiag.daq.records.events import Chunk, Event, Loss
from testkit.recording import HEADER, START_NS, recording

EVENTS = recording(1.0)
STOP = Note("/machine/stop", START_NS, {"setup": "ppp", "stop": 3})


def read(path: Path) -> list[Event]:
    return list(open_log(path).events())


def wait_until(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


class Bench:
    """A recorder and everything it said of itself."""

    def __init__(self, backlog_bytes: int = 16_000_000) -> None:
        self.said: list[RecorderHealth] = []
        self.recorder = Recorder(self.said.append, backlog_bytes=backlog_bytes)

    def admit(self, events: list[Event]) -> list[Event]:
        return [admitted for event in events for admitted in self.recorder.admit(event)]

    @property
    def states(self) -> list[str]:
        return [health.state for health in self.said]


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.recorder.stop()


def test_what_was_admitted_is_replayed_and_the_log_gets_its_name(
    bench: Bench, tmp_path: Path
) -> None:
    path = tmp_path / "survey" / "0001.mcap"
    bench.recorder.begin(path, HEADER)
    admitted = bench.admit(EVENTS)
    wait_until(path.with_name("0001.mcap.part").exists)
    assert not path.exists()
    bench.recorder.end("complete")
    assert bench.recorder.stop()
    assert admitted == EVENTS
    assert read(path) == EVENTS
    assert [each.name for each in path.parent.iterdir()] == ["0001.mcap"]
    assert bench.states == ["recording", "idle"]


def test_one_log_after_another(bench: Bench, tmp_path: Path) -> None:
    for number in range(3):
        bench.recorder.begin(tmp_path / f"{number}.mcap", HEADER)
        bench.admit(EVENTS[number::3])
        bench.recorder.end("complete", f"pass {number}")
    assert bench.recorder.stop()
    for number in range(3):
        assert read(tmp_path / f"{number}.mcap") == EVENTS[number::3]


def test_nanoseconds_are_cut_before_anybody_sees_them(bench: Bench, tmp_path: Path) -> None:
    """Live and replay must see the same stamps."""
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    (admitted,) = bench.recorder.admit(Chunk("laser", START_NS + 1999, b"x"))
    assert admitted == Chunk("laser", START_NS + 1000, b"x")


def test_a_captured_stop_is_synced_at_once(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power failure right after a stop does not lose it: the sync does not wait for its turn."""
    synced: list[int] = []
    monkeypatch.setattr("stepdiag.daq.log.recorder.FLUSH_S", 1e6)
    monkeypatch.setattr(
        PartFile,
        "sync",
        lambda file: synced.append(open_log_messages(file.part)["/machine/stop"]),
    )
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    bench.admit(EVENTS[:50])
    wait_until(lambda: bench.states == ["recording"])
    bench.recorder.promise(STOP, lambda: None)
    wait_until(lambda: 1 in synced)


def test_nobody_is_told_of_a_stop_before_it_is_in_the_file(
    bench: Bench, tmp_path: Path
) -> None:
    """What a person or the machine was told survives the death of the process, with the bytes that
    it was made of."""
    seen: list[Counter[str]] = []
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    for number in range(0, 50, 10):
        bench.admit(EVENTS[number : number + 10])
        bench.recorder.promise(
            STOP, lambda: seen.append(open_log_messages(tmp_path / "a.mcap.part"))
        )
    wait_until(lambda: len(seen) == 5)
    assert [found["/machine/stop"] >= told for told, found in enumerate(seen, start=1)] == [
        True
    ] * 5


def test_a_stop_during_a_sync_is_synced_after_it(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sync that has begun says nothing of the bytes that came after."""
    begun, go_on = threading.Semaphore(0), threading.Semaphore(0)

    def slow(_file: PartFile) -> None:
        begun.release()
        go_on.acquire()

    monkeypatch.setattr(PartFile, "sync", slow)
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    bench.admit(EVENTS[:50])
    assert begun.acquire(timeout=60)
    bench.recorder.promise(STOP, lambda: None)
    wait_until(lambda: open_log_messages(tmp_path / "a.mcap.part").get("/machine/stop") == 1)
    go_on.release()
    assert begun.acquire(timeout=60)
    go_on.release(100)


def test_a_sync_that_fails_is_told(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_file: PartFile) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(PartFile, "sync", broken)
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    bench.admit(EVENTS[:50])
    bench.recorder.promise(STOP, lambda: None)
    wait_until(lambda: "blocked" in bench.states)
    assert next(
        health for health in bench.said if health.state == "blocked"
    ).reason == message("os-io")


def open_log_messages(path: Path) -> Counter[str]:
    log = open_log(path)
    for _event in log.events():
        pass
    assert log.end is not None
    return Counter(log.end.messages)


def test_a_file_that_exists_is_not_touched_and_the_death_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"recorded before")
    bench = Bench()
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    wait_until(lambda: bench.states == ["dead"])
    assert "FileExistsError" in bench.recorder.health.reason
    assert bench.admit(EVENTS[:5]) == []
    assert bench.recorder.health.lost_events == 5
    assert not bench.recorder.stop()
    assert (tmp_path / "a.mcap").read_bytes() == b"recorded before"


def test_a_name_taken_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    bench = Bench()
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    bench.admit(EVENTS[:50])
    wait_until(lambda: bench.states == ["recording"])
    (tmp_path / "a.mcap").write_bytes(b"another's")
    bench.recorder.end("complete")
    assert not bench.recorder.stop()
    assert (tmp_path / "a.mcap").read_bytes() == b"another's"
    assert read(tmp_path / "a.mcap.part") == EVENTS[:50]


def test_any_error_of_the_thread_is_told(bench: Bench) -> None:
    """No thread dies alone (style.md A3, rule 11)."""
    bench.recorder.begin(Path("/"), HEADER)
    bench.recorder.note(log_note(0, "info", "words", "daq"))
    bench.admit(EVENTS[:1])
    wait_until(lambda: "dead" in bench.states)
    assert bench.recorder.health.state == "dead"


@contextmanager
def full_disk(length: int) -> Iterator[None]:
    """The kernel refuses to write beyond a length, as a full disk does: EFBIG by RLIMIT_FSIZE
    (Python ignores SIGXFSZ).

    No longer than it takes: what pytest says of the test may go into a file that is longer.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (length, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_stops_the_recording_loudly_and_it_goes_on(tmp_path: Path) -> None:
    bench = Bench(backlog_bytes=100_000)
    many = recording(6.0)
    with full_disk(6_000):
        bench.recorder.begin(tmp_path / "a.mcap", HEADER)
        admitted = bench.admit(many[:2000])
        wait_until(lambda: bench.recorder.health.state == "blocked")
        assert bench.recorder.health.reason == os.strerror(errno.EFBIG)
        admitted += bench.admit(many[2000:4000])
        readable = read(tmp_path / "a.mcap.part")
    wait_until(
        lambda: (
            bench.recorder.health.state == "recording"
            and not bench.recorder.health.backlog_bytes
        )
    )
    admitted += bench.admit(many[4000:4300])
    bench.recorder.end("complete")
    assert bench.recorder.stop()
    lost = [event for event in admitted if isinstance(event, Loss)]
    assert (
        sum(loss.events for loss in lost)
        == 4300 - (len(admitted) - len(lost))
        == bench.recorder.health.lost_events
        > 0
    )
    assert bench.states == ["recording", "blocked", "recording", "idle"]
    assert readable == admitted[: len(readable)]
    log = open_log(tmp_path / "a.mcap")
    assert list(log.events()) == admitted
    assert log.end is not None
    assert log.end.run_stop["lost_events"] == str(bench.recorder.health.lost_events)


def test_a_stop_that_a_full_disk_refuses_is_not_captured_until_there_is_space(
    tmp_path: Path,
) -> None:
    """The machine must not move on from a stop that a power cut would take away."""
    bench, told = Bench(), threading.Event()
    with full_disk(6_000):
        bench.recorder.begin(tmp_path / "a.mcap", HEADER)
        bench.admit(recording(6.0)[:2000])
        bench.recorder.promise(STOP, told.set)
        wait_until(lambda: bench.recorder.health.state == "blocked")
        assert not told.is_set()
    assert told.wait(60.0)
    assert open_log_messages(tmp_path / "a.mcap.part")["/machine/stop"] == 1
    bench.recorder.end("complete")
    assert bench.recorder.stop()


def test_a_disk_that_stays_full_leaves_what_was_written(tmp_path: Path) -> None:
    bench = Bench()
    with full_disk(8_000):
        bench.recorder.begin(tmp_path / "a.mcap", HEADER)
        admitted = bench.admit(EVENTS)
        bench.recorder.end("complete")
        wait_until(lambda: bench.recorder.health.state == "blocked")
        assert not bench.recorder.stop(timeout_s=5.0)
        kept = read(tmp_path / "a.mcap.part")
        assert kept == admitted[: len(kept)]
        assert not (tmp_path / "a.mcap").exists()


def test_admitting_never_waits_for_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sync of a tenth of a second (its p99, baselines.md) must not reach the caller."""
    begun, hold, synced = threading.Event(), threading.Event(), threading.Event()
    monkeypatch.setattr(
        PartFile, "sync", lambda _file: (begun.set(), hold.wait(60.0), synced.set())
    )
    bench = Bench()
    bench.recorder.begin(tmp_path / "a.mcap", HEADER)
    assert begun.wait(60.0)
    bench.admit(EVENTS)
    assert not synced.is_set()
    hold.set()
    bench.recorder.end("complete")
    assert bench.recorder.stop()


def test_a_folder_that_cannot_be_made_blocks_until_it_can(tmp_path: Path) -> None:
    (tmp_path / "in-the-way").write_bytes(b"")
    bench = Bench()
    bench.recorder.begin(tmp_path / "in-the-way" / "deep" / "a.mcap", HEADER)
    admitted = bench.admit(EVENTS)
    wait_until(lambda: bench.recorder.health.state == "blocked")
    (tmp_path / "in-the-way").unlink()
    bench.recorder.end("complete")
    wait_until(lambda: bench.recorder.health.state == "idle")
    assert bench.recorder.stop()
    assert read(tmp_path / "in-the-way" / "deep" / "a.mcap") == admitted == EVENTS


KILLED = """
    import sys, time
    from pathlib import Path
    from testkit.recording import HEADER, START_NS, laser_line
    from stepdiag.daq.records.events import Chunk
    from stepdiag.daq.log.recorder import Recorder

    recorder = Recorder(lambda health: None)
    recorder.begin(Path(sys.argv[1]), HEADER)
    number = 0
    while True:
        now_ns = time.monotonic_ns()
        recorder.admit(Chunk("laser", now_ns, laser_line(number)))
        number += 1
        print(now_ns, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.parametrize("seconds", [0.7, 1.15])
def test_a_killed_process_loses_at_most_half_a_second(tmp_path: Path, seconds: float) -> None:
    """kill -9 at a moment between flushes; what was handed to the recorder earlier than half a
    second before is in the file."""
    path = tmp_path / "a.mcap"
    paths = os.pathsep.join([str(Path(__file__).parents[2] / "lib")])
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": paths}
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
        stamps = [int(line) for line in process.stdout.read().split(b"\n")[:-1]]
    kept = read(path.with_name("a.mcap.part"))
    assert isinstance(kept[-1], Chunk)
    stood_still_ns = sum(
        max(0, later - earlier - 2_500_000) for earlier, later in pairwise(stamps)
    )
    assert stamps[-1] - kept[-1].arrival_ns < 500_000_000 + stood_still_ns


def test_flush_and_sync_keep_the_promises() -> None:
    """Half a second for a killed process, one second for a power failure, each with room for the
    write itself."""
    assert FLUSH_S < 0.5
    assert SYNC_S <= 1.0
