"""Tests on real sockets, ptys and processes hold only where nothing stands still for longer than
they can spare.

What stands still is seldom a whole computer. A line does where every process goes on: what is
written to a pty comes to its reader by a worker of the kernel, and a scheduler can leave that
worker behind all others. On Linux 6.18 with a group for each session (sched(7), autogroup) bytes
came up to 1.5 s late beside eight tests, while a process in front of all others was never late by
0.05 s; without the groups no byte was late by 0.05 s, and no test was tried again.
"""

import os
import select
import threading
import time
import tty
from contextlib import contextmanager

from _pytest.runner import runtestprotocol

BEAT_S = 0.02
SPARE_S = 0.25
"""What a patient machine can spare: a laser that nobody read for half a second is doubted."""
IMPATIENT_SPARE_S = 0.03
"""Of a machine that does not wait: a dwell of these tests lasts 0.6 s; with settling, window and
polls a stop can be late by 0.1 s before it is another one. The virtual machine computes while
this process only looks at the clock, and stands still three times as long on a computer that is
shared."""
ATTEMPTS = 6


class Standstill:
    """How long a processor or a line has stood still at most, and all of them together, in s, while
    they were watched."""

    worst_s = 0.0
    total_s = 0.0

    def add(self, late_s):
        self.worst_s = max(self.worst_s, late_s)
        self.total_s += late_s if late_s > BEAT_S / 2 else 0.0


@contextmanager
def watched():
    """Watch how long each processor stands still, from a thread on each: daemon and virtual machine
    may be on another than this process.

    And how long a byte takes through a pty.
    """
    standstill, ended = Standstill(), threading.Event()

    def beat(processor):
        os.sched_setaffinity(threading.get_native_id(), {processor})
        last = time.monotonic()
        over = False
        while not over:
            over = ended.wait(BEAT_S)
            now = time.monotonic()
            standstill.add(max(0.0, now - last - BEAT_S))
            last = now

    with pty_line() as line:
        threads = [
            threading.Thread(target=beat, args=(each,), name=f"standstill {each}")
            for each in os.sched_getaffinity(0)
        ]
        threads.append(
            threading.Thread(
                target=_through, args=(line, standstill, ended), name="standstill of a line"
            )
        )
        for thread in threads:
            thread.start()
        try:
            yield standstill
        finally:
            ended.set()
            for thread in threads:
                thread.join()


@contextmanager
def pty_line():
    """Open a pty, its two ends as descriptors: where an instrument writes, where its reader
    reads."""
    ends = os.openpty()
    try:
        tty.setraw(ends[1])
        yield ends
    finally:
        for end in ends:
            os.close(end)


def _through(line, standstill, ended):
    writes, reads = line
    while not ended.wait(BEAT_S):
        sent = time.monotonic()
        os.write(writes, b"x")
        select.select([reads], [], [])
        os.read(reads, 1)
        standstill.add(time.monotonic() - sent)


def run_steadily(item, nextitem):
    """Run a test as pytest does, and again, with fixtures of its own, where it failed while
    something stood still.

    A stop lost to that is the product's to name, not a fault of it. A test that fails where
    everything went on, or fails every time, has failed. How often it was tried again is in its
    record (`tools/slowest` prints it).
    """
    spare_s = IMPATIENT_SPARE_S if item.get_closest_marker("impatient") else SPARE_S
    again = []
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(1, ATTEMPTS + 1):
        with watched() as standstill:
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if attempt == ATTEMPTS or standstill.worst_s < spare_s or not _missed(reports):
            break
        again.append(
            f"attempt {attempt}: something stood still for {standstill.worst_s:.2f} s; once more"
        )
    for report in reports:
        if again:
            report.sections.append(("Captured stdout call", "\n".join(again)))
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _missed(reports):
    """Return whether the test itself failed, and not for want of time: its limit is that of all
    attempts together."""
    return any(
        report.when == "call" and report.failed and "Timeout (>" not in report.longreprtext
        for report in reports
    )
