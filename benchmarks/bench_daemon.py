"""What the daemon costs beside a machine: processor, memory, how true its arrival stamps are, log
size, start."""

import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from threading import Event, Thread

import numpy as np

from benchmarks.stand import UNIT_NICE, Process, daemon, feeding, logged, running
from benchmarks.table import Row
from stepdiag.daq.records.events import Chunk

RATE_HZ = 1000.0
SETTLE_S = 3.0
MOST_PROCESSOR = 2.0
MOST_LATE = 2.0
MOST_VIEWER = 1.0
MOST_START, MOST_HELP = 60, 15
"""Times the floor of the same run: the bare loop, and a Python that does nothing."""


def rows(seconds: float) -> list[Row]:
    """Return the rows of the daemon at a usual instrument, each part measured for ``seconds``."""
    floor, alone = at_rest(seconds, bare), at_rest(seconds)
    with running("benchmarks.solving"):
        busy, solving = at_rest(seconds, bare), at_rest(seconds)
    return [
        *alone.cost(floor),
        *solving.stamps("while another survey is solved", busy),
        *page(seconds, floor),
        *starts(),
    ]


class AtRest:
    """One run of the daemon, or of the bare loop, at 1,000 samples/s and 50 polls/s."""

    def __init__(
        self,
        cpu_percent: float,
        resident_mb: float,
        delays_ms: np.ndarray,
        bytes_a_sample: float = 0.0,
    ) -> None:
        self.cpu_percent = cpu_percent
        self.resident_mb = resident_mb
        self.delays_ms = delays_ms
        self.bytes_a_sample = bytes_a_sample

    def cost(self, floor: "AtRest") -> list[Row]:
        """Return processor, memory and log size."""
        ratio = self.cpu_percent / floor.cpu_percent
        return [
            Row(
                "1,000 samples/s, 50 polls/s: processor",
                f"{self.cpu_percent:.1f} % of a core",
                f"bare loop: {floor.cpu_percent:.1f} %",
                f"{ratio:.1f}",
                f"ratio {MOST_PROCESSOR:g}",
                ratio <= MOST_PROCESSOR,
            ),
            Row(
                "the same: resident memory",
                f"{self.resident_mb:.0f} MB",
                goal="70 MB",
                met=self.resident_mb <= 70,
            ),
            Row(
                "log of umd lines at rest",
                f"{self.bytes_a_sample:.1f} bytes a sample",
                goal="12",
                met=self.bytes_a_sample <= 12,
            ),
            *self.stamps("alone", floor),
        ]

    def stamps(self, when: str, floor: "AtRest") -> list[Row]:
        """Return how late arrival stamps are."""
        (p50, p99), bare99 = (
            np.percentile(self.delays_ms, [50, 99]),
            float(np.percentile(floor.delays_ms, 99)),
        )
        ratio = p99 / bare99
        return [
            Row(
                f"arrival stamp, {when}",
                f"p99 {p99:.2f} ms, p50 {p50:.2f} ms",
                f"bare loop: p99 {bare99:.2f} ms",
                f"{ratio:.1f}",
                f"ratio {MOST_LATE:g}",
                bool(ratio <= MOST_LATE),
            )
        ]


@contextmanager
def bare(survey: Path) -> Iterator[tuple[Process, float]]:
    """Run the bare loop in the daemon's place."""
    laser, plc = (
        section["port"]
        for name, section in tomllib.loads(survey.read_text()).items()
        if name in ("laser", "plc")
    )
    with running(
        "benchmarks.bare",
        "--laser",
        laser,
        "--plc",
        plc,
        "--stamps",
        survey.parent / "bare.npy",
        nice=UNIT_NICE,
    ) as process:
        yield Process(process.pid), 0.0


def at_rest(
    seconds: float,
    recorder: Callable[[Path], AbstractContextManager[tuple[Process, float]]] = daemon,
) -> AtRest:
    """Run the daemon, or the bare loop, beside a board that writes a line a millisecond."""
    with tempfile.TemporaryDirectory() as name:
        stamps, stamped = Path(name) / "stamps.npy", Path(name) / "bare.npy"
        with feeding(Path(name), RATE_HZ, every_s=0.001, stamps=stamps) as survey:
            with recorder(survey) as (process, _):
                time.sleep(SETTLE_S)
                percent = process.percent_over(seconds)
                resident = process.resident_mb()
            size, _, chunks = (0, 0, []) if recorder is bare else logged(survey)
        if recorder is bare:
            return AtRest(
                percent, resident, late_ms(np.load(stamped).tolist(), np.load(stamps))
            )
        return AtRest(
            percent,
            resident,
            delays_ms(chunks, np.load(stamps)),
            size / sum(chunk.data.count(b"\n") for chunk in chunks),
        )


def delays_ms(chunks: Sequence[Chunk], written: np.ndarray) -> np.ndarray:
    """Return by how much the stamp of each chunk is later than the writing of its last line."""
    last = [
        (int(chunk.data.split(b"\r\n")[-2].split()[5]), chunk.arrival_ns)
        for chunk in chunks[1:]
        if chunk.data.count(b"\r\n") > 1
    ]
    return late_ms(last, written)


def late_ms(stamped: Sequence[tuple[int, int]], written: np.ndarray) -> np.ndarray:
    """Return by how much the stamps (number of the line, ns) are later than the writing of their
    lines."""
    times = dict(written.tolist())
    return (
        np.array([stamp - times[number] for number, stamp in stamped if number in times])
        * 1e-6
    )


def page(seconds: float, floor: AtRest) -> list[Row]:
    """Return what the page adds while one browser looks on."""
    with (
        tempfile.TemporaryDirectory() as name,
        feeding(Path(name), RATE_HZ, page=True, every_s=0.001) as survey,
    ):
        port = survey.read_text().partition("[page]")[2].split("port = ")[1].split()[0]
        with daemon(survey) as (process, _):
            time.sleep(SETTLE_S)
            both = [process, *process.children()]
            before = _percent_over(both, seconds)
            with Viewer(f"http://127.0.0.1:{port}/stream"):
                time.sleep(SETTLE_S)
                after = _percent_over(both, seconds)
            resident = sum(each.resident_mb() for each in both)
    recording, added = after[0] - before[0], sum(after) - sum(before)
    figure = (
        f"{added:.1f} % of a core ({recording:.1f} % in the recording process), {resident:.0f} "
        "MB in all"
    )
    ratio = added / floor.cpu_percent
    return [
        Row(
            "page: what one viewer adds",
            figure,
            f"bare loop: {floor.cpu_percent:.1f} %",
            f"{ratio:.1f}",
            f"ratio {MOST_VIEWER:g}",
            ratio <= MOST_VIEWER,
        )
    ]


def _percent_over(processes: list[Process], seconds: float) -> list[float]:
    """Return what share of a core each process uses for so long from now."""
    began, before = time.monotonic(), [each.cpu_s() for each in processes]
    time.sleep(seconds)
    took = time.monotonic() - began
    return [
        100 * (each.cpu_s() - used) / took
        for each, used in zip(processes, before, strict=True)
    ]


class Viewer:
    """Reads a stream of events in a thread until the block ends."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._done = Event()
        self._thread = Thread(target=self._read, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join(5)

    def _read(self) -> None:
        with urllib.request.urlopen(self._address, timeout=10) as stream:
            while not self._done.is_set() and stream.readline():
                pass


def starts() -> list[Row]:
    """Return how long the daemon and the command line take to start."""
    with (
        tempfile.TemporaryDirectory() as name,
        feeding(Path(name), RATE_HZ, page=True) as survey,
    ):
        ready = []
        for _ in range(5):
            with daemon(survey) as (_, ready_s):
                ready.append(ready_s)
                time.sleep(0.2)
    python = statistics.median(command_s("-c", "pass") for _ in range(5))
    help_s = statistics.median(command_s("-m", "stepdiag", "--help") for _ in range(5))
    start = statistics.median(ready)
    return [
        Row(
            "start of the daemon to READY",
            f"{start:.2f} s",
            f"bare Python {python:.3f} s",
            f"{start / python:.0f}",
            f"ratio {MOST_START}",
            start < MOST_START * python,
        ),
        Row(
            "stepdiag --help",
            f"{help_s:.2f} s",
            f"bare Python {python:.3f} s",
            f"{help_s / python:.0f}",
            f"ratio {MOST_HELP}",
            help_s < MOST_HELP * python,
        ),
    ]


def _start(what: str, took_s: float, python_s: float, most: float) -> Row:
    ratio = took_s / python_s
    return Row(
        what,
        f"{took_s:.2f} s",
        f"bare Python {python_s:.3f} s",
        f"{ratio:.0f}",
        f"ratio {most:g}",
        ratio < most,
    )


def command_s(*arguments: str) -> float:
    """Return how long a Python process takes."""
    began = time.monotonic()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    return time.monotonic() - began
