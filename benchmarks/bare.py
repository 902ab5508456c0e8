"""``python -m benchmarks.bare``: the least that a recorder does: the same reads of the laser and
polls of the PLC, nothing made of them.

A thread reads the pty and stamps what came; the main thread asks the PLC for the contract's block
at the rate of the survey. At SIGTERM the stamps are kept.
"""

import argparse
import os
import signal
import socket
import struct
import threading
import time
import tty
from pathlib import Path

import numpy as np

from stepdiag.daq.timing.host_clock import now_ns

REQUEST = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, 0, 14)


def main() -> None:
    """Read and poll until SIGTERM."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--laser", type=Path, required=True)
    parser.add_argument("--plc", type=int, required=True)
    parser.add_argument("--poll-hz", type=float, default=50.0)
    parser.add_argument("--stamps", type=Path, required=True)
    options = parser.parse_args()
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    descriptor = os.open(options.laser, os.O_RDONLY | os.O_NOCTTY)
    tty.setraw(descriptor)
    stamps: list[tuple[int, int]] = []
    threading.Thread(target=read, args=(descriptor, stamps), daemon=True).start()
    with socket.create_connection(("127.0.0.1", options.plc)) as plc:
        poll(plc, 1.0 / options.poll_hz, done)
    np.save(options.stamps, np.array(stamps, dtype=np.int64))
    os._exit(0)  # the reading thread waits for ever


def read(descriptor: int, stamps: list[tuple[int, int]]) -> None:
    """Read, stamp, and keep the number of the last whole line of every chunk."""
    while data := os.read(descriptor, 65536):
        arrived_ns = now_ns()
        lines = data.split(b"\r\n")
        if len(lines) > 2:
            stamps.append((int(lines[-2].split()[5]), arrived_ns))


def poll(plc: socket.socket, period_s: float, done: threading.Event) -> None:
    """Ask for the block on a fixed schedule."""
    due = time.monotonic()
    while not done.is_set():
        plc.sendall(REQUEST)
        plc.recv(260)
        due += period_s
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    main()
