"""The daemon beside a feeder, each a process of its own, and what it costs."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from stepdiag.daq.log.contents import open_log
from stepdiag.daq.records.events import Chunk
from stepdiag.virtual.base.reserved import reserved_port

SURVEY = """
[survey]
name = "bench"
machine = "bench"
[volume]
size_mm = [500.0, 400.0, 300.0]
increments = 10
[laser]
format = "umd"
port = "{laser}"
baud = 4000000
[plc]
port = {plc_port}
poll_hz = 50.0
[page]
enabled = {page}
port = {page_port}
[metrics]
enabled = false
"""
UNIT_NICE = -10
"""As systemd/stepdiag@.service runs it; without the rights of root the daemon runs at the usual
priority."""
_CPUCLOCK_SCHED = 2
"""The clock of a process' processor time, in ns where /proc counts hundredths of a second
(clock_getcpuclockid(3))."""


@dataclass(frozen=True, slots=True)
class Process:
    """A process as the kernel sees it."""

    pid: int

    def cpu_s(self) -> float:
        """Return the processor time used so far, children that have ended not counted."""
        return time.clock_gettime(~self.pid << 3 | _CPUCLOCK_SCHED)

    def children(self) -> list["Process"]:
        """Return the processes that this one has started and that still run."""
        pids = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
        return [Process(int(pid)) for pid in pids]

    def percent_over(self, seconds: float) -> float:
        """Return what share of a core is used for so long from now."""
        began, before = time.monotonic(), self.cpu_s()
        time.sleep(seconds)
        return 100 * (self.cpu_s() - before) / (time.monotonic() - began)

    def resident_mb(self) -> float:
        """Return the memory that is resident now."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024


@contextmanager
def running(
    *command: object, env: dict[str, str] | None = None, nice: int = 0
) -> Iterator[subprocess.Popen[str]]:
    """Run a Python module until the block ends; it is then told to end and waited for."""
    with subprocess.Popen(
        [sys.executable, "-m", *map(str, command)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, **(env or {})},
    ) as process:
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, process.pid, nice)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(60)


@contextmanager
def feeding(
    folder: Path, rate_hz: float, *, page: bool = False, **options: object
) -> Iterator[Path]:
    """Run a feeder; yield the survey file that fits it."""
    given = [
        part
        for name, value in options.items()
        for part in (f"--{name.replace('_', '-')}", value)
    ]
    with running(
        "benchmarks.feeder", "--rate", rate_hz, "--link", folder / "laser", *given
    ) as feeder:
        assert feeder.stdout is not None
        ready = json.loads(feeder.stdout.readline())
        survey = folder / "survey.toml"
        survey.write_text(
            SURVEY.format(**ready, page=str(page).lower(), page_port=reserved_port())
        )
        yield survey


@contextmanager
def daemon(survey: Path) -> Iterator[tuple[Process, float]]:
    """Run the daemon; yield it and the seconds from its start to READY, as systemd is told."""
    address = survey.parent / "notify"
    address.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(address))
        listener.settimeout(30.0)
        began = time.monotonic()
        with running(
            "stepdiag", "run", survey, env={"NOTIFY_SOCKET": str(address)}, nice=UNIT_NICE
        ) as process:
            while listener.recv(4096) != b"READY=1":
                pass
            ready_s = time.monotonic() - began
            listener.close()
            yield Process(process.pid), ready_s


def logged(survey: Path) -> tuple[int, int, list[Chunk]]:
    """Return of the survey's only log: its bytes, the lost events, and the laser's chunks."""
    (path,) = (survey.parent / "bench" / "0001").glob("*.mcap")
    log = open_log(path)
    chunks = [event for event in log.events() if isinstance(event, Chunk)]
    assert log.end is not None
    return path.stat().st_size, int(log.end.run_stop["lost_events"]), chunks


def peak_mb() -> float:
    """Return the most memory that was resident in this process; getrusage(2) would count its
    parent's before exec(2)."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024
