"""Inputs of the reference cases of daq/formats: streams of bytes, settings at their limits, tables
of registers."""

from collections.abc import Iterator
from itertools import chain

import _daq_framing
import _daq_heads
import _daq_lasers
import _daq_maps
import _daq_umd
from _daq_limits import limits
from _daq_wire import Case


def inputs() -> Iterator[Case]:
    """Yield the name of every case, who plays it, and its input."""
    rooms = (_daq_framing, _daq_umd, _daq_lasers, _daq_heads, _daq_maps)
    yield from chain.from_iterable(room.inputs() for room in rooms)
    yield from ((f"settings-{kind}", "settings", told) for kind, told in limits().items())


CASES = {
    name: (name.replace("-", " "), call, lambda told=told: told)
    for name, call, told in inputs()
}
