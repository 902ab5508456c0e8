"""Tests whose machine does not wait: they hold only where nothing stands still for as long as a dwell has to spare."""

import functools
import os
import threading
import time
from contextlib import contextmanager

from stepdiag.solver.errors import DeviceError

BEAT_S = 0.01
SPARE_S = 0.03
"""A dwell of these tests lasts 0.6 s; with settling, window and polls a stop can be late by 0.1 s before it is another one. The virtual
machine computes while this process only looks at the clock, and stands still three times as long on a computer that is shared."""
ATTEMPTS = 6


class Standstill:
    """How long one of the processors has stood still at most, and all of them together, in s, while they were watched."""

    worst_s = 0.0
    total_s = 0.0


@contextmanager
def watched():
    """Watch how long each processor stands still, from a thread on each: daemon and virtual machine may be on another than this process."""
    standstill, ended = Standstill(), threading.Event()

    def beat(processor):
        os.sched_setaffinity(threading.get_native_id(), {processor})
        last = time.monotonic()
        over = False
        while not over:
            over = ended.wait(BEAT_S)
            now = time.monotonic()
            late_s, last = max(0.0, now - last - BEAT_S), now
            standstill.worst_s = max(standstill.worst_s, late_s)
            standstill.total_s += late_s if late_s > BEAT_S / 2 else 0.0

    threads = [threading.Thread(target=beat, args=(each,), name=f"standstill {each}") for each in os.sched_getaffinity(0)]
    for thread in threads:
        thread.start()
    try:
        yield standstill
    finally:
        ended.set()
        for thread in threads:
            thread.join()


def on_a_steady_computer(test):
    """Try a test again, in a folder of its own, where it failed while the whole computer stood still.

    A virtual computer is taken away for a second now and then; a stop lost to that is the product's to name, not a fault of it. A test that
    fails on a computer that went on, or fails every time, has failed.
    """

    @functools.wraps(test)
    def tried(tmp_path, **fixtures):
        for attempt in range(1, ATTEMPTS + 1):
            folder, failure = tmp_path / str(attempt), None
            folder.mkdir()
            with watched() as standstill:
                try:
                    test(folder, **fixtures)
                except (AssertionError, DeviceError) as error:
                    failure = error
            if failure is None:
                return
            if attempt == ATTEMPTS or standstill.worst_s < SPARE_S:
                raise failure
            print(f"attempt {attempt}: the computer stood still for {standstill.worst_s:.2f} s; once more")

    return tried
