"""Polls the machine on a fixed schedule, in sessions that a Reconnector repeats."""

import asyncio
from collections.abc import Callable, Sequence

import structlog

from stepdiag.base.messages import Words, joined
from stepdiag.daq.links.controls.machine import MachineLink, MachineSettings, open_machine
from stepdiag.daq.links.controls.modbus_errors import (
    RefusedRequestError,
    SilentDeviceError,
    StaleAnswerError,
)
from stepdiag.daq.links.reconnect import Report, raise_if_cancelled
from stepdiag.daq.records.events import ModbusBlock, ReadRange

_log = structlog.get_logger(__name__)

SILENT_POLLS_TO_RECONNECT = 3
LATER = 1.5
REFUSED_WAIT_S = 1.0
"""Period in s of the polls of a device that refuses every request, because its program may still be
starting.
"""


class MachinePoller:
    """Reads the ranges every ``period_s`` and passes each block on, in the event loop.

    The schedule starts at the first poll; a poll that is due during another poll is left out.
    ``on_written`` is called after every write of a register with the reason of a refusal, or
    without a reason after a success.
    """

    def __init__(
        self,
        settings: MachineSettings,
        ranges: Sequence[ReadRange],
        period_s: float,
        on_block: Callable[[ModbusBlock], None],
        on_written: Callable[[Words], None] = lambda _: None,
    ) -> None:
        self._settings = settings
        self._ranges = tuple(ranges)
        self._period_s = period_s
        self._on_block = on_block
        self._on_written = on_written
        self._pending: tuple[str, int, int] | None = None
        self._rest: asyncio.Future[None] | None = None
        self._late_s = 0.0

    async def session(self, report: Report) -> None:
        """Connect and poll until the device is lost or three polls in a row have no answer. Raises
        DeviceError.
        """
        link = await open_machine(self._settings, self._ranges)
        try:
            await self._poll(link, report)
        finally:
            link.close()

    def write_soon(self, table: str, address: int, value: int) -> None:
        """Write one word as soon as there is a connection and no poll runs; a later word replaces a
        waiting word.
        """
        self._pending = (table, address, value)
        _end(self._rest)

    async def _poll(self, link: MachineLink, report: Report) -> None:
        clock = asyncio.get_running_loop().time
        due = clock()
        failures = 0
        while True:
            try:
                await self._until(due, link)
                await self._write_pending(link)
                self._on_block(await link.read())
            except (SilentDeviceError, StaleAnswerError) as error:
                failures += 1
                if failures == SILENT_POLLS_TO_RECONNECT:
                    raise
                report("silent", error.message)
            except RefusedRequestError as error:
                report("silent", error.message)
                await asyncio.sleep(REFUSED_WAIT_S)
            else:
                failures = 0
                report("connected", _describe(link, self._settings))
                self._say_late(link)
            due += self._period_s * max(1, -((due - clock()) // self._period_s))

    def _say_late(self, link: MachineLink) -> None:
        """Report that answers arrive after their time-out. The report is repeated when the delay
        has grown by half.
        """
        if link.lateness.after_s > LATER * self._late_s:
            self._late_s = link.lateness.after_s
            _log.warning(
                "answers-late",
                link="machine",
                detail=f"{self._settings.address}: {link.lateness.words}",
            )

    async def _until(self, due: float, link: MachineLink) -> None:
        raise_if_cancelled()
        loop = asyncio.get_running_loop()
        while loop.time() < due:
            if self._pending is not None:
                await self._write_pending(link)
                continue
            self._rest = loop.create_future()
            timer = loop.call_at(due, _end, self._rest)
            try:
                await self._rest
            finally:
                timer.cancel()

    async def _write_pending(self, link: MachineLink) -> None:
        """Write the pending word. A refused register is not written again, and polling continues
        without the handshake.
        """
        pending = self._pending
        if pending is None:
            return
        refused: Words = ""
        try:
            await link.write_word(*pending)
        except RefusedRequestError as error:
            refused = error.message
            _log.warning("write-refused", detail=str(error))
        if self._pending is pending:
            self._pending = None
        self._on_written(refused)


def _end(rest: asyncio.Future[None] | None) -> None:
    if rest is not None and not rest.done():
        rest.set_result(None)


def _describe(link: MachineLink, settings: MachineSettings) -> Words:
    late = link.lateness.words
    if not (late or link.refusals):
        return settings.address
    return joined(
        [
            settings.address,
            *(error.message for error in link.refusals.values()),
            *([late] if late else []),
        ]
    )
