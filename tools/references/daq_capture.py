"""Inputs of the reference cases of daq/capture: windows, dwells, walks, and whole logs of machines that do what machines do."""

from collections.abc import Iterator
from itertools import chain

import _capture_logs
import _capture_places
import _capture_said
import _capture_standing
from _capture_kit import Case


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from chain.from_iterable(room.inputs() for room in (_capture_standing, _capture_places, _capture_said, _capture_logs))


CASES = {name: (name.replace("-", " "), call, lambda told=told: told) for name, call, told in inputs()}
