"""Reopens a lost link, for serial lines and controls.

A session is a coroutine function: it opens its device, works until the device is lost, closes the
device, and raises DeviceError. Any other exception is a fault of the program and also ends the
reconnector, so that no session ends unnoticed.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

import structlog

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import Words, message
from stepdiag.daq.records.events import with_lost
from stepdiag.daq.records.status import LinkState

FIRST_WAIT_S = 0.05
WAIT_GROWTH = 2.0
LONGEST_WAIT_S = 1.0
"""Longest wait in s between two attempts. A device is connected within two seconds of its return,
including the time of an attempt.
"""
STEADY_AFTER_S = 5.0
"""Least duration in s of a session that resets the wait to its shortest value."""


class Report(Protocol):
    """A function that receives the state of a link, a detail for the operator, and the losses since
    the last report.
    """

    def __call__(
        self, state: LinkState, detail: Words, lost: tuple[Words, ...] = ()
    ) -> None: ...


Session = Callable[[Report], Awaitable[None]]

_log = structlog.get_logger(__name__)


class Reconnector:
    """Runs one session after another on a link.

    ``on_state`` is called in the event loop at every change of state and every loss of bytes. The
    first failure is logged as a warning, and later failures at debug level until the link is open
    again.
    """

    def __init__(self, name: str, session: Session, on_state: Report) -> None:
        self._name = name
        self._session = session
        self._on_state = on_state
        self._warned = False
        self.state: LinkState = "connecting"

    async def run(self) -> None:
        """Keep the link open until cancelled. Raises every exception that is no DeviceError."""
        clock = asyncio.get_running_loop().time
        self._on_state("connecting", "")
        wait_s = FIRST_WAIT_S
        while True:
            began = clock()
            try:
                await self._session(self._report)
            except DeviceError as error:
                self._lost(error.message)
            else:
                self._lost(message("session-ended"))
            raise_if_cancelled()
            if clock() - began > STEADY_AFTER_S:
                wait_s = FIRST_WAIT_S
            await asyncio.sleep(wait_s)
            wait_s = min(wait_s * WAIT_GROWTH, LONGEST_WAIT_S)

    def _report(self, state: LinkState, detail: Words, lost: tuple[Words, ...] = ()) -> None:
        """Report a change of state, and separately a loss of bytes, because a loss does not change
        the state of the link.
        """
        if state == self.state and not lost:
            return
        if state != self.state:
            self._change(state, with_lost(detail, lost))
        if lost:
            _log.warning(
                "link-lost-bytes", link=self._name, detail=str(with_lost(detail, lost))
            )
        self._on_state(state, detail, lost)

    def _change(self, state: LinkState, detail: Words) -> None:
        self.state = state
        if state == "connected":
            self._warned = False
            _log.info("link-connected", link=self._name, detail=str(detail))
        else:
            self._complain(f"link-{state}", detail)

    def _lost(self, detail: Words) -> None:
        if self.state == "lost":
            self._complain("link-lost", detail)
        self._report("lost", detail)

    def _complain(self, event: str, detail: Words) -> None:
        say = _log.debug if self._warned else _log.warning
        self._warned = True
        say(event, link=self._name, detail=str(detail))


def raise_if_cancelled() -> None:
    """Raise CancelledError if this task was cancelled while an answer arrived. Before Python 3.12,
    `asyncio.wait_for` (in which the client waits) then returns the answer and loses the
    cancellation, so the daemon would never stop.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
