"""Keeping a link: an object for serial lines and Modbus.

A session is a coroutine function: it opens its device, works until the device is lost, closes it,
and ends by raising DeviceError. Any other exception is a fault of this program and ends the
reconnector too, so that no worker dies unseen.
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
"""With the time that an attempt takes, a device is back within two seconds of its return."""
STEADY_AFTER_S = 5.0
"""A session that ends sooner does not make the next wait short again."""


class Report(Protocol):
    """Takes the state of a link, a detail for a person, and what was lost since that was last
    reported."""

    def __call__(self, state: LinkState, detail: Words, lost: tuple[Words, ...] = ()) -> None: ...


Session = Callable[[Report], Awaitable[None]]

_log = structlog.get_logger(__name__)


class Reconnector:
    """Runs session after session of one link.

    ``on_state`` is called at every change of state and every loss of bytes, in the event loop; the
    first failure is logged as a warning, those that follow at debug level, until the link is there
    again.
    """

    def __init__(self, name: str, session: Session, on_state: Report) -> None:
        self._name = name
        self._session = session
        self._on_state = on_state
        self._warned = False
        self.state: LinkState = "connecting"

    async def run(self) -> None:
        """Keep the link until cancelled. Raises what is not a DeviceError."""
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
        """Report a change of state, and a loss of bytes beside it: what was lost never stands for
        what the link has become."""
        if state == self.state and not lost:
            return
        if state != self.state:
            self._change(state, with_lost(detail, lost))
        if lost:
            _log.warning("link-lost-bytes", link=self._name, detail=str(with_lost(detail, lost)))
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
        """Warn once; the same trouble again is for debugging."""
        say = _log.debug if self._warned else _log.warning
        self._warned = True
        say(event, link=self._name, detail=str(detail))


def raise_if_cancelled() -> None:
    """End here if this task was cancelled while an answer came: before Python 3.12
    `asyncio.wait_for`, in which the client waits, then returns the answer and loses the order, and
    the daemon would never stop.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
