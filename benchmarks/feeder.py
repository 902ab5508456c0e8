"""``python -m benchmarks.feeder``: a laser on a pty and a PLC on Modbus TCP whose program runs, as
a process of its own.

It prints one JSON line with its addresses. The laser is a uMD2 board at rest, with noise; the PLC
says that setup 1 runs and never stops.
"""

import argparse
import json
import os
import select
import signal
import socketserver
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np

from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.virtual.base.ports import SerialLine
from stepdiag.virtual.instruments.lasers import BOARDS, UmdBoard

_HEADER = struct.Struct(">HHHB")
NOISE_MM = 2e-5
_WORDS = 14


class Plc(socketserver.BaseRequestHandler):
    """Answers every request with the contract's block."""

    def handle(self) -> None:
        """Serve one connection until it ends."""
        began = time.monotonic()
        while request := self.request.recv(260):
            transaction, _, _, unit = _HEADER.unpack_from(request)
            words = [
                int(time.monotonic() - began) & 0xFFFF,
                0,
                2,
                1,
                *[0] * 6,
                2000,
                2000,
                10130,
                500,
            ]
            answer = struct.pack(f">BB{_WORDS}H", 3, 2 * _WORDS, *words)
            self.request.sendall(_HEADER.pack(transaction, 0, len(answer) + 1, unit) + answer)


def main() -> None:
    """Feed until SIGTERM, or until standard input ends."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=float, required=True)
    parser.add_argument(
        "--every-s", type=float, default=0.005, help="how often lines are written"
    )
    parser.add_argument(
        "--stamps", type=Path, help="where the time of each line's writing is kept"
    )
    parser.add_argument("--link", type=Path, required=True)
    options = parser.parse_args()
    socketserver.ThreadingTCPServer.daemon_threads = True
    server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Plc)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    line = SerialLine(options.link, lossless=options.stamps is None)
    done = threading.Event()

    def end(*_: object) -> None:
        done.set()
        line.end()

    signal.signal(signal.SIGTERM, end)
    sys.stdout.write(
        json.dumps({"laser": str(options.link), "plc_port": server.server_address[1]}) + "\n"
    )
    sys.stdout.flush()
    feed(line, options.rate, options.every_s, options.stamps, done)
    line.unplug()
    os._exit(0)  # the handlers of open connections wait for ever


def feed(
    line: SerialLine,
    rate_hz: float,
    every_s: float,
    stamps: Path | None,
    done: threading.Event,
) -> None:
    """Write lines at a rate; those that are late are made up for."""
    board = UmdBoard(BOARDS["umd2"], rate_hz=rate_hz)
    noise = np.random.default_rng(1)
    sent, began, times = 0, time.monotonic(), []
    while not done.is_set():
        due = int((time.monotonic() - began) * rate_hz) - sent
        due = min(due, int(0.02 * rate_hz) + 1)
        if due > 0:
            lines = board.encode(
                100.0 + noise.normal(0.0, NOISE_MM, due), np.ones(due, dtype=bool)
            )
            line.write(lines)
            sent += due
            times.append((sent - 1, now_ns()))
        pause = (
            began + (sent + 1) / rate_hz - time.monotonic()
            if every_s * rate_hz <= 1
            else every_s
        )
        if pause > 0:
            select.select([], [], [], pause)
    if stamps is not None:
        np.save(stamps, np.array(times, dtype=np.int64))


if __name__ == "__main__":
    main()
