"""Child processes of the demo (virtual machine and daemon), which print one JSON object per
line."""

import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from queue import Empty, Queue
from threading import Thread

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import message

END_S = 120.0
"""Longest time in s for a process to end on request."""
REMEMBERED = 20
"""Number of lines of a failed process in its error message."""


@contextmanager
def ended_in_order() -> Iterator[None]:
    """End the block, and the processes it started, when this process receives SIGTERM or its
    terminal is closed.

    By default, Python ends at once, and the virtual machine and the daemon continue to run.
    """

    def leave(number: int, _frame: object) -> None:
        for each in before:
            signal.signal(
                each, signal.SIG_IGN
            )  # a second signal would interrupt the ending that the first signal started
        sys.exit(128 + number)

    before = {each: signal.signal(each, leave) for each in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass(slots=True)
class Talker:
    """A child process that prints one JSON object per line."""

    process: subprocess.Popen[str]
    lines: Queue[str | None]
    ready: dict[str, str]
    last: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    """The last lines of the process, oldest first."""

    def next(self, timeout_s: float, what: str) -> dict[str, str]:
        """Return the next object of the process. Raises DeviceError for a process that ends or is
        silent."""
        try:
            line = self.lines.get(timeout=timeout_s)
        except Empty as silence:
            raise DeviceError(
                what,
                expected=message("answer-within", seconds_s=timeout_s),
                found=message("silence"),
            ) from silence
        if line is None:
            raise DeviceError(
                what,
                expected=message("running-process"),
                found=message("exit-code", code=self.process.wait()),
            )
        self.last.append(line.strip())
        try:
            event: dict[str, str] = json.loads(line)
        except json.JSONDecodeError:
            return {"event": "text", "text": line.strip()}
        return event

    def poll(self) -> dict[str, str] | None:
        """Return the next object that has already arrived, otherwise None."""
        return None if self.lines.empty() else self.next(1.0, "process")

    def say(self, text: str) -> None:
        if self.process.stdin is not None:
            self.process.stdin.write(f"{text}\n")
            self.process.stdin.flush()


@contextmanager
def talking(command: Sequence[str], *, errors: bool) -> Iterator[Talker]:
    """Run a process and read its lines: the daemon's from standard error, the bench's from standard
    output. The process ends together with the thread that started it, even if this program is
    killed."""
    process = subprocess.Popen(
        ("setpriv", "--pdeathsig", "TERM", *command),
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL if errors else subprocess.PIPE,
        stderr=subprocess.PIPE if errors else None,
        text=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    stream = process.stderr if errors else process.stdout
    lines: Queue[str | None] = Queue()

    def listen() -> None:
        for line in stream or ():
            lines.put(line)
        lines.put(None)

    listener = Thread(target=listen, name=f"listen {command[2]}", daemon=True)
    listener.start()
    try:
        yield Talker(process, lines, {})
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        listener.join(timeout=5.0)
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()
