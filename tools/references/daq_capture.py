"""Inputs of the reference cases of daq/capture: windows, dwells, walks, and whole logs of machines
that do what machines do."""

from collections.abc import Iterator
from itertools import chain
from typing import Any

import _capture_logs
import _capture_places
import _capture_said
import _capture_standing
from _capture_kit import Case

NUMBERS = ("noise", "alike", "same", "line", "fading", "turns")


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    yield from chain.from_iterable(
        room.inputs()
        for room in (_capture_standing, _capture_places, _capture_said, _capture_logs)
    )


def short(told: Any) -> Any:
    """Return an input with the parts of its series as texts, where they hold numbers alone."""
    if isinstance(told, dict):
        return {name: short(each) for name, each in told.items()}
    if not isinstance(told, list | tuple):
        return told
    if told and told[0] in NUMBERS:
        return " ".join(map(str, told))
    return [short(each) for each in told]


CASES = {
    name: (name.replace("-", " "), call, lambda told=told: short(told))
    for name, call, told in inputs()
}
