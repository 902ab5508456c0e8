"""How fast the daemon takes lines from a pty: logged, decoded, synchronised, nothing lost."""

import os
import tempfile
import termios
import time
import tty
from pathlib import Path

from benchmarks.stand import daemon, feeding, logged
from benchmarks.table import Row

RATE_HZ = 110_000.0


def rows(seconds: float) -> list[Row]:
    """Return the rows of ingest, measured for ``seconds``."""
    floor_us = floor(min(seconds, 10.0))
    with tempfile.TemporaryDirectory() as name, feeding(Path(name), RATE_HZ) as survey:
        with daemon(survey) as (process, _):
            time.sleep(2.0)
            began, before = time.monotonic(), process.cpu_s()
            time.sleep(seconds)
            cpu_s, lasted_s = process.cpu_s() - before, time.monotonic() - began
        _, lost, chunks = logged(survey)
    lines = sum(chunk.data.count(b"\n") for chunk in chunks)
    rate = lines / ((chunks[-1].arrival_ns - chunks[0].arrival_ns) * 1e-9)
    numbers = [
        int(text.split(b"\r\n")[at].split()[5])
        for text, at in ((chunks[0].data, 1), (chunks[-1].data, -2))
    ]
    missing = numbers[1] - numbers[0] + 2 - lines
    each_us = cpu_s / (rate * lasted_s) * 1e6
    whole = lost == 0 and abs(missing) <= 1
    return [
        Row(
            "ingest: pty, log, decode, synchronise",
            f"{rate:,.0f} samples/s for {lasted_s:.0f} s, {lost} events lost",
            goal=f"nothing lost of {RATE_HZ:,.0f} a second",
            met=whole,
        ),
        Row(
            "ingest: processor time a sample",
            f"{each_us:.2f} us",
            f"read and split: {floor_us:.2f} us",
            f"{each_us / floor_us:.1f}",
            "ratio 4",
            each_us <= 4 * floor_us,
        ),
    ]


def floor(seconds: float) -> float:
    """Return the processor time of reading the same lines and splitting them into fields, in us a
    line."""
    with tempfile.TemporaryDirectory() as name, feeding(Path(name), RATE_HZ):
        descriptor = os.open(Path(name) / "laser", os.O_RDONLY | os.O_NOCTTY)
        tty.setraw(descriptor)
        termios.tcflush(descriptor, termios.TCIFLUSH)
        lines, rest = 0, b""
        began, before = time.monotonic(), time.process_time()
        while time.monotonic() - began < seconds:
            *whole, rest = (rest + os.read(descriptor, 65536)).split(b"\n")
            for line in whole:
                line.split()
            lines += len(whole)
        used = time.process_time() - before
        os.close(descriptor)
    return used / lines * 1e6
