"""The rooms of daq/capture, played from an input as it stands in a reference file: no clock, no
port, every time an argument."""

from collections.abc import Callable
from typing import Any

from testkit.references.daq_capture import logs, place, said, standing

CALLS: dict[str, Callable[[Any], Any]] = {
    "windows": standing.windows,
    "plateaus": standing.plateaus,
    "certain": standing.certain,
    "taken": standing.taken,
    "dwells": standing.dwells,
    "standstills": standing.standstills,
    "parts": standing.parts,
    "heads": standing.heads,
    "routes": place.routes,
    "agreeing": place.agreeing,
    "names": place.names,
    "finder": place.finder,
    "directions": place.directions,
    "turned": place.turned,
    "positions": place.positions,
    "conditions": said.conditions,
    "sensors": said.sensors,
    "remarks": said.remarks,
    "unsaid": said.unsaid,
    "starts": said.starts,
    "log": logs.log,
    "by-laser": logs.by_laser,
}
