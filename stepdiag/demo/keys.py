"""The keyboard of a terminal, read key by key without waiting; without a terminal, the bytes of
standard input."""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass(slots=True)
class Keyboard:
    number: int
    ended: bool = False

    def pressed(self) -> str:
        """Return the key pressed since the last call; empty without a key."""
        if self.ended or not select.select([self.number], [], [], 0.0)[0]:
            return ""
        read = os.read(self.number, 1)
        self.ended = not read
        return read.decode("latin-1")


@contextmanager
def keyboard() -> Iterator[Keyboard]:
    """Read single keys while the block runs; restore the settings of the terminal afterwards."""
    number = sys.stdin.fileno()
    if not os.isatty(number):
        yield Keyboard(number)
        return
    import termios
    import tty

    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number)
        yield Keyboard(number)
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)
