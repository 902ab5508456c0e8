"""Outcomes of following a log: stops, findings, and the end of its pass."""

from dataclasses import dataclass
from typing import Literal

from stepdiag.base.findings import Finding
from stepdiag.base.messages import Message
from stepdiag.daq.capture.captured_stop import CapturedStop


@dataclass(frozen=True, slots=True)
class Ended:
    """The pass of this log is over: every stop has gone by, or the program left it."""

    kind: Literal["complete", "aborted"]
    reason: Message


Outcome = CapturedStop | Finding | Ended
