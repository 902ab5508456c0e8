"""The machine's Modbus: the only user of pymodbus (3.16; its API changes within a major version).

One connection reads a block of ranges with the same requests at every poll. pymodbus repeats no
request: a poll without an answer fails after a short wait, and the next poll reads the present
values.
"""

import asyncio
import logging
import socket
import struct
import termios
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from stepdiag.base.errors import system_words
from stepdiag.base.messages import message
from stepdiag.daq.links.controls.blocking import Waiter
from stepdiag.daq.links.controls.blocking import unreachable as no_way
from stepdiag.daq.links.controls.modbus_errors import (
    LostConnectionError,
    RefusedRequestError,
    lost,
    refusal,
    silence,
    stale,
    unreachable,
    unusable,
)
from stepdiag.daq.links.ports.address import network_line
from stepdiag.daq.links.ports.lateness import Lateness
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.timing.host_clock import stamp_ns

logging.getLogger("pymodbus.logging").setLevel(
    logging.CRITICAL
)  # failures of pymodbus are raised as errors, and the reconnector reports each error once

_FIREWALL = message("firewall-modbus")
CONNECT_S = 2.0
"""Least time in s for connecting, even if the time-out for answers is shorter: TCP repeats a lost
first packet after one second (RFC 6298, 2.1).
"""
RTU_WORST_ANSWER_S = 1.0
"""Longest wait in s for a late answer on a serial line. An answer after this time is recognised by
its length.
"""
_ATTEMPTS_TO_GET_IN_STEP = 3
"""Number of probes (`_probe`) before the link is closed. From the second probe on, the link waits
`RTU_WORST_ANSWER_S` before each probe.
"""
_WRITE_REGISTERS = 0x10
_READS: dict[str, tuple[str, int]] = {
    "coil": ("read_coils", 1),
    "discrete": ("read_discrete_inputs", 2),
    "holding": ("read_holding_registers", 3),
    "input": ("read_input_registers", 4),
}
Client = AsyncModbusTcpClient | AsyncModbusSerialClient


@dataclass(frozen=True, slots=True, kw_only=True)
class TcpSettings:
    host: str
    port: int = 502
    unit: int = 1
    timeout_s: float = 0.3
    connect_s: float = CONNECT_S

    @property
    def address(self) -> str:
        return f"Modbus {self.host}:{self.port} unit {self.unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RtuSettings:
    """Settings of a Modbus slave on a serial line; ``port`` may be the ``socket://host:port`` of a
    terminal server.
    """

    port: str
    baud: int = 19200
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1
    unit: int = 1
    timeout_s: float = 0.3
    connect_s: float = CONNECT_S

    @property
    def address(self) -> str:
        return f"Modbus {self.port} unit {self.unit}"


ModbusSettings = TcpSettings | RtuSettings


class ModbusLink:
    """A connection to the machine, made by `open_link`, ended by ``close``.

    A serial line carries no transaction number: without a check, a late answer would be assigned to
    the next request, and every later answer to a wrong request, without an error. So every answer
    must have the expected length. After an answer of another length the line is synchronised before
    the next request.
    """

    def __init__(
        self,
        settings: ModbusSettings,
        ranges: Sequence[ReadRange],
        client: Client,
        lateness: Lateness,
    ) -> None:
        self.lateness = lateness
        self._settings = settings
        self._ranges = tuple(ranges)
        self._client = client
        self._turn = asyncio.Lock()
        self._in_step = isinstance(settings, TcpSettings)
        self._wait_s = 0.0
        self.refusals: dict[ReadRange, RefusedRequestError] = {}
        """The ranges refused in the last poll."""

    async def read(self) -> ModbusBlock:
        """Poll the ranges (`MachineLink.read`).

        Raises SilentDeviceError, StaleAnswerError or LostConnectionError, and RefusedRequestError
        if every range is refused.
        """
        async with self._turn:
            await self._get_in_step()
            self.refusals = {}
            send_ns = stamp_ns()
            data = tuple([await self._read_or_refuse(wanted) for wanted in self._ranges])
            recv_ns = stamp_ns()
        if self._ranges and len(self.refusals) == len(set(self._ranges)):
            raise self.refusals[self._ranges[0]]
        return ModbusBlock(send_ns, recv_ns, self._ranges, data)

    async def write_word(self, table: str, address: int, value: int) -> None:  # noqa: ARG002 - a control takes words in holding registers alone
        """Write the low 16 bits of ``value`` into a holding register with function code 10h, which
        every writable control supports.

        Raises the errors of ``read``.
        """
        async with self._turn:
            await self._get_in_step()
            answer = await self._exchange(
                lambda: self._client.write_registers(
                    address, [value % 65536], device_id=self._settings.unit
                )
            )
            if answer.isError():
                self._in_step = True
                raise refusal(
                    self._settings.address,
                    message("writing-register", address=address),
                    answer.exception_code,
                )
            if answer.function_code != _WRITE_REGISTERS:
                raise stale(self._settings.address, self.lateness.words)
            self._in_step = True

    def close(self) -> None:
        self._client.close()

    async def _read_or_refuse(self, wanted: ReadRange) -> bytes:
        answer = await self._read_range(wanted)
        if answer.isError():
            self._in_step = True
            what = message(
                "reading-table",
                count=wanted.count,
                table=wanted.table,
                address=wanted.address,
            )
            self.refusals[wanted] = refusal(
                self._settings.address, what, answer.exception_code
            )
            return b""
        data = _wire_bytes(wanted, answer)
        if data is None:
            raise stale(self._settings.address, self.lateness.words)
        self._in_step = True
        return data

    async def _read_range(self, wanted: ReadRange) -> ModbusPDU:
        read = getattr(self._client, _READS[wanted.table][0])
        return await self._exchange(
            lambda: read(wanted.address, count=wanted.count, device_id=self._settings.unit)
        )

    async def _exchange(self, request: Callable[[], Awaitable[ModbusPDU]]) -> ModbusPDU:
        """Send a request and await its answer. The link counts as unsynchronised until the caller
        has checked the answer, because the next answer after a cancelled request may belong to this
        request.
        """
        self._in_step = isinstance(self._settings, TcpSettings)
        try:
            answer = await request()  # without a connection ``request`` raises the error
        except (ModbusException, OSError) as error:
            self.lateness.given_up()
            if self._client.connected:
                serial = isinstance(self._settings, RtuSettings)
                raise silence(
                    self._settings.address,
                    self._settings.timeout_s,
                    serial=serial,
                    late=self.lateness.words,
                ) from error
            raise lost(self._settings.address) from error
        self.lateness.answered()
        return answer

    async def _get_in_step(self) -> None:
        """Ensure that the next answer belongs to the next request.

        Late answers are awaited and discarded. Then a probe is sent: a read with a length that no
        range has. An answer of this length, or an exception, is the answer to the probe. A slave
        answers in order, so no older answer can follow.
        """
        for _ in range(_ATTEMPTS_TO_GET_IN_STEP):
            if self._in_step:
                return
            await asyncio.sleep(self._wait_s)
            self._wait_s = RTU_WORST_ANSWER_S
            probe = _probe(self._ranges)
            answer = await self._read_range(probe)
            self._in_step = answer.isError() or _wire_bytes(probe, answer) is not None
            if not self._in_step:
                self.lateness.was_of_an_earlier()
        if not self._in_step:
            raise stale(self._settings.address, self.lateness.words)


async def open_link(settings: ModbusSettings, ranges: Sequence[ReadRange]) -> ModbusLink:
    """Connect to the machine, to read ``ranges``. Raises LostConnectionError for a missing device
    or port.
    """
    lateness = Lateness(numbered=isinstance(settings, TcpSettings))
    client = _client(settings, lateness)
    try:
        connected = await client.connect()
    except (OSError, termios.error) as error:
        client.close()
        raise unusable(settings.address, system_words(error)) from error
    if not connected:
        client.close()
        raise await _nobody(settings)
    answer_within(client, settings.timeout_s)
    return ModbusLink(settings, ranges, client, lateness)


async def _nobody(settings: ModbusSettings) -> LostConnectionError:
    """Return the reason for a missing connection. pymodbus hides the reason, so this function
    connects once more.

    Looking up the host's name has no time limit: if the name server does not answer, the thread of
    the look-up keeps running.
    """
    if isinstance(settings, TcpSettings):
        asking = Waiter("modbus again", lambda: None, lambda: None)
        try:
            place = (settings.host, settings.port)
            await asking.call(
                lambda: socket.create_connection(place, settings.connect_s).close(),
                2.0 * settings.connect_s,
            )
        except OSError as error:
            found, remedy = no_way(error, settings.connect_s, "Modbus TCP", _FIREWALL)
            return LostConnectionError(
                settings.address,
                expected=message("expects-connection"),
                found=found,
                remedy=remedy,
            )
        finally:
            asking.end()
    return unreachable(settings.address, settings.connect_s)


def answer_within(client: Client, timeout_s: float) -> None:
    """Set the client's time limit for answers. While connecting, the same setting limits the time
    for connecting.
    """
    client.ctx.comm_params.timeout_connect = timeout_s


def _client(settings: ModbusSettings, lateness: Lateness) -> Client:
    """Return a client that neither retries nor reconnects, because the reconnector does both."""
    if isinstance(settings, TcpSettings):
        return AsyncModbusTcpClient(
            settings.host,
            port=settings.port,
            timeout=settings.connect_s,
            retries=0,
            reconnect_delay=0,
            trace_packet=lateness.trace,
        )
    line = network_line(settings.port)
    if line is not None:
        return AsyncModbusTcpClient(
            line.host,
            port=line.port,
            framer=FramerType.RTU,
            timeout=settings.connect_s,
            retries=0,
            reconnect_delay=0,
        )
    return AsyncModbusSerialClient(
        settings.port,
        baudrate=settings.baud,
        parity=settings.parity,
        stopbits=settings.stopbits,
        timeout=settings.connect_s,
        retries=0,
        reconnect_delay=0,
        trace_packet=lateness.trace,
    )


def _wire_bytes(wanted: ReadRange, answer: ModbusPDU) -> bytes | None:
    if answer.function_code != _READS[wanted.table][1]:
        return None
    if wanted.table in ("coil", "discrete"):
        bits = sum(1 << place for place, bit in enumerate(answer.bits) if bit)
        data = bits.to_bytes((len(answer.bits) + 7) // 8, "little")
    else:
        data = struct.pack(f">{len(answer.registers)}H", *answer.registers)
    return data if len(data) == wanted.byte_count else None


def _probe(ranges: Sequence[ReadRange]) -> ReadRange:
    first = ranges[0] if ranges else ReadRange("holding", 0, 1)
    lengths = {wanted.byte_count for wanted in ranges}
    unit = 8 if first.table in ("coil", "discrete") else 1
    candidates = (
        ReadRange(first.table, first.address, 1 + unit * more)
        for more in range(len(lengths) + 1)
    )
    return next(probe for probe in candidates if probe.byte_count not in lengths)
