"""From the end of a stop's window to the handshake in the PLC's register, over a whole survey on
the virtual machine."""

import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.bare import REQUEST
from benchmarks.stand import daemon
from benchmarks.table import Row
from stepdiag.daq.recording.rounds import noted_stops
from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.config import read_config
from stepdiag.virtual.plc.plc import Plc

POLL_HZ = 50.0
MOST = 1.5
BENCH = """
time_scale = 10.0
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 10
[program]
passes = 1
feed_mm_min = 30000.0
acceleration_mm_s2 = 4000.0
dwell_s = 0.1
start = "command"
handshake = true
[laser]
optics = 1
noise_um = 0.2
chunk_s = 0.005
"""
"""The laser sends every 5 ms: readings that wait in an instrument are not the daemon's time."""
SURVEY = """
[survey]
name = "bench"
machine = "bench"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 10
[plan]
return_pass = false
dwell_s = 0.6
[laser]
format = "umd"
port = "{laser}"
[plc]
port = {plc}
poll_hz = {poll_hz}
[plc.handshake]
enabled = true
[stop]
settle_s = 0.05
min_window_s = 0.1
max_scatter_um = 5.0
[page]
enabled = false
"""


def rows() -> list[Row]:
    """Return the row of the handshake."""
    late_ms, bare_ms = lateness_ms()
    p50, p99 = np.percentile(late_ms, [50, 99])
    floor = 1e3 / POLL_HZ + float(np.percentile(bare_ms, 99))
    figure, beside = (
        f"p99 {p99:.1f} ms, p50 {p50:.1f} ms of {len(late_ms)} stops",
        f"poll period and bare exchange: {floor:.1f} ms",
    )
    ratio = p99 / floor
    return [
        Row(
            "stop captured: window's end to handshake",
            figure,
            beside,
            f"{ratio:.1f}",
            f"ratio {MOST:g}",
            bool(ratio <= MOST),
        )
    ]


def exchanges_ms(port: int) -> np.ndarray:
    """Return how long the PLC takes to answer somebody who does nothing but ask, paced like the
    daemon's polls."""
    took = []
    with socket.create_connection(("127.0.0.1", port)) as plc:
        for _ in range(100):
            began = time.monotonic()
            plc.sendall(REQUEST)
            plc.recv(260)
            took.append(time.monotonic() - began)
            time.sleep(1.0 / POLL_HZ)
    return np.array(took) * 1e3


def lateness_ms() -> tuple[np.ndarray, np.ndarray]:
    """Return for each stop of a survey the time from its window's end to its count in the register,
    and bare exchanges, in ms."""
    written: dict[int, int] = {}

    def write(plc: Plc, table: str, address: int, values: Sequence[int]) -> None:
        written.setdefault(values[0], now_ns())
        original(plc, table, address, values)

    original = Plc.write
    sys.setswitchinterval(
        0.0002
    )  # the machine's threads must not wait for each other: that is not the daemon's time
    with tempfile.TemporaryDirectory() as name, patch.object(Plc, "write", write):
        folder = Path(name)
        (folder / "bench.toml").write_text(BENCH)
        waiting: list[dict[str, str]] = []
        with VirtualBench(
            read_config(folder / "bench.toml"), folder, tell=waiting.append
        ) as bench:
            survey = folder / "survey.toml"
            places = bench.addresses
            survey.write_text(
                SURVEY.format(
                    laser=places["laser_link"], plc=places["plc_port"], poll_hz=POLL_HZ
                )
            )
            bare_ms = exchanges_ms(int(places["plc_port"]))
            with daemon(survey):
                _drive(bench, waiting)
        stops = [
            stop
            for log in sorted((folder / "bench").rglob("*.mcap"))
            for stop in noted_stops(log)
        ]
    pairs = [
        (stop.window_to_ns, written[stop.stop_count])
        for stop in stops
        if stop.stop_count in written
    ]
    return np.array([after - window for window, after in pairs]) * 1e-6, bare_ms


def _drive(bench: VirtualBench, told: list[dict[str, str]]) -> None:
    """Start every setup as soon as it waits, until the program is over."""
    time.sleep(1.0)
    begun, end = 0, time.monotonic() + 180
    while not any(event["event"] == "finished" for event in told) and time.monotonic() < end:
        if sum(event["event"] == "waiting" for event in told) > begun:
            begun += 1
            bench.start_setup()
        time.sleep(0.05)
    time.sleep(1.0)
