"""Outcomes of the events of a log: stops, findings, and the end of its pass."""

from dataclasses import dataclass
from typing import Literal

from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message
from stepdiag.daq.capture.captured_stop import CapturedStop


@dataclass(frozen=True, slots=True)
class Ended:
    """The pass of this log is over: the machine has passed every stop, or the program has left the
    pass.
    """

    kind: Literal["complete", "aborted"]
    reason: Message


Outcome = CapturedStop | Finding | Ended
