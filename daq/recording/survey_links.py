"""The links of a survey, made from the survey file. Received data become events in the event loop.

A chunk does not wake the loop: the polls of the machine run the loop at least every 50 ms, and
sixty more wake-ups a second would cost a tenth of the daemon's work.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator

from stepdiag.base.messages import Words, message
from stepdiag.daq.formats.signals import plan_reads
from stepdiag.daq.links.controls.lsv2 import Lsv2Settings
from stepdiag.daq.links.controls.machine import MachineSettings
from stepdiag.daq.links.controls.modbus import RtuSettings, TcpSettings
from stepdiag.daq.links.controls.poller import MachinePoller
from stepdiag.daq.links.controls.s7 import S7Settings
from stepdiag.daq.links.ports.address import network_line
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.serial import OnChunk, SerialStream, instrument_line
from stepdiag.daq.links.reconnect import Reconnector, Report
from stepdiag.daq.records.events import Chunk, Event, LinkEvent, Loss, ModbusBlock, Stream
from stepdiag.daq.records.status import LinkState, LinkStatus
from stepdiag.daq.survey.formats import decoders
from stepdiag.daq.survey.models import Plc, SerialSection, Survey
from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.daq.timing.samples import Decoder

Consume = Callable[[Event], None]
Statuses = tuple[LinkStatus, LinkStatus, LinkStatus | None, LinkStatus | None]
WAKE_NS = 30_000_000
"""Time in ns since the last collection of chunks after which a new chunk wakes the loop."""
SLICE_NS = 100_000_000
"""Longest time in ns in which the loop processes chunks before other work; an intact instrument
sends less than this in several seconds.
"""
MOST_WAITING_BYTES = 4_000_000
"""Largest number of waiting bytes, ten seconds of the fastest line; further chunks are lost, and
the loss is reported.
"""


class SurveyLinks:
    """The links of laser, machine and, if present, 4-DOF head and sensor of air.

    ``consume`` is called in the event loop, in the order of arrival. ``on_written`` is called after
    every write of a register, with the reason of a refusal, or without a reason after a success.
    """

    def __init__(
        self,
        survey: Survey,
        consume: Consume,
        on_written: Callable[[Words], None] = lambda _: None,
    ) -> None:
        self._survey = survey
        self._consume = consume
        self._loop = asyncio.get_running_loop()
        self._heard_ns: dict[str, int] = {}
        self._details: dict[str, Words] = {}
        self._arrived: deque[Chunk] = deque()
        self._collected_ns = 0
        self._woken = self._hurried = False
        self._rests_until_ns = 0
        self._arrived_bytes = self._lost_chunks = self._lost_bytes = 0
        self._failed: asyncio.Future[None] = self._loop.create_future()
        self._streams: list[SerialStream] = []
        sections = _sections(survey)
        made = decoders(survey).items()
        self._lines: dict[str, Reconnector] = {
            name: self._line(name, section, decoder)
            for name, decoder in made
            if (section := sections[name]) is not None
        }
        if not survey.plc.silent:
            self._poller = self._machine(on_written)
            self._lines["machine"] = Reconnector(
                "machine", self._poller.session, self._reporter("machine")
            )
        self._tasks: list[asyncio.Task[None]] = []

    async def run(self) -> None:
        """Keep all links open until cancelled. Raises the error of a fault of this program that
        ended a link.
        """
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._fail(), name="collect")
                self._tasks = [
                    group.create_task(line.run(), name=name)
                    for name, line in self._lines.items()
                ]
        finally:
            self.collect()

    def collect(self) -> None:
        """Pass the arrived chunks to ``consume``.

        After `SLICE_NS` of work, the method passes on no chunk for as long as the work took. So the
        loop can poll the machine, answer the page and end the daemon even if a line sends too much.
        """
        self._woken = False
        self._collected_ns = began_ns = now_ns()
        if began_ns < self._rests_until_ns:
            return
        while self._arrived:
            chunk = self._arrived.popleft()
            self._arrived_bytes -= len(chunk.data)
            self._heard_ns[chunk.stream] = chunk.arrival_ns
            self._consume(chunk)
            if self._arrived and (took_ns := now_ns() - began_ns) > SLICE_NS:
                self._rests_until_ns = began_ns + 2 * took_ns
                self._loop.call_later(took_ns * 1e-9, self._collect_or_fail)
                return
        if self._lost_chunks and not self._arrived:
            chunks, size, self._lost_chunks, self._lost_bytes = (
                self._lost_chunks,
                self._lost_bytes,
                0,
                0,
            )
            self._consume(Loss(now_ns(), chunks, size, message("line-overloads")))

    def hurry(self) -> None:
        """Collect every chunk as soon as it arrives, until the next poll, because the machine waits
        for the answer to a stop.
        """
        self._hurried = True
        for stream in self._streams:
            stream.hurry()

    def acknowledge(self, stop_count: int) -> None:
        """Write the count of a captured stop into the configured register of the machine, once,
        before the next poll.
        """
        place = self._survey.plc.handshake
        self._poller.write_soon(place.table, place.address, stop_count)

    def dead(self) -> Iterator[str]:
        return (task.get_name() for task in self._tasks if task.done())

    def statuses(self) -> Statuses:
        """Return the state of the links of laser, machine, head and sensor of air."""
        head, air = (
            self._status(name) if name in self._lines else None for name in ("head", "air")
        )
        return self._status("laser"), self._status("machine"), head, air

    def _status(self, name: str) -> LinkStatus:
        if name not in self._lines:
            return LinkStatus(
                state="connected",
                address=message("no-signals-laser-alone"),
                age_s=None,
                detail="",
            )
        heard = self._heard_ns.get(name)
        return LinkStatus(
            state=self._lines[name].state,
            address=_address(self._survey, name),
            age_s=None if heard is None else max(0.0, (now_ns() - heard) * 1e-9),
            detail=self._details.get(name, ""),
        )

    def _machine(self, on_written: Callable[[Words], None]) -> MachinePoller:
        plc = self._survey.plc
        reads = plan_reads(
            plc.signals, () if plc.transport == "s7" else plc.standing
        )  # an S7 answers all ranges in one telegram
        return MachinePoller(
            machine_settings(plc), reads, 1.0 / plc.poll_hz, self._polled, on_written
        )

    def _line(self, stream: Stream, section: SerialSection, decoder: Decoder) -> Reconnector:
        line = instrument_line(serial_settings(section), decoder, self._receiver(stream))
        if isinstance(line, SerialStream):
            self._streams.append(line)
        return Reconnector(stream, line.session, self._reporter(stream))

    def _receiver(self, stream: Stream) -> OnChunk:
        def arrived(data: bytes, arrival_ns: int) -> None:
            if self._arrived_bytes > MOST_WAITING_BYTES:
                self._lost_chunks += 1
                self._lost_bytes += len(data)
                return
            self._arrived_bytes += len(data)
            self._arrived.append(Chunk(stream, arrival_ns, data))
            if self._hurried or arrival_ns - self._collected_ns > WAKE_NS:
                self._wake()

        return arrived

    def _wake(self) -> None:
        """Make the loop collect chunks once more, after the work that is already queued. Any thread
        may call this method; repeated calls before the next collection have no further effect.
        """
        if not self._woken:
            self._woken = True
            self._loop.call_soon_threadsafe(self._collect_or_fail)

    def _collect_or_fail(self) -> None:
        """Collect chunks in a separate turn of the loop. A failure ends `run`, because no caller
        would notice the failure.
        """
        try:
            self.collect()
        except Exception as fault:  # noqa: BLE001 - raised by `run`
            if not self._failed.done():
                self._failed.set_exception(fault)

    async def _fail(self) -> None:
        await self._failed

    def _reporter(self, name: str) -> Report:
        def changed(state: LinkState, detail: Words, lost: tuple[Words, ...] = ()) -> None:
            change = LinkEvent(now_ns(), name, state, detail, lost)  # type: ignore[arg-type]
            self._details[name] = change.words
            self.collect()
            self._consume(change)

        return changed

    def _polled(self, block: ModbusBlock) -> None:
        self._hurried = False
        self.collect()
        self._heard_ns["machine"] = block.recv_ns
        self._consume(block)


def machine_settings(plc: Plc) -> MachineSettings:
    if plc.transport == "tcp":
        return TcpSettings(
            host=plc.host, port=plc.tcp_port, unit=plc.unit, timeout_s=plc.timeout_s
        )
    if plc.transport == "s7":
        return S7Settings(
            host=plc.host,
            port=plc.tcp_port,
            rack=plc.rack,
            slot=plc.slot,
            timeout_s=plc.timeout_s,
        )
    if plc.transport == "lsv2":
        return Lsv2Settings(host=plc.host, port=plc.tcp_port, timeout_s=plc.timeout_s)
    return RtuSettings(
        port=plc.serial_port,
        baud=plc.baud,
        parity=plc.parity,
        stopbits=plc.stopbits,
        unit=plc.unit,
        timeout_s=plc.timeout_s,
    )


def serial_settings(section: SerialSection) -> SerialSettings:
    return SerialSettings(
        port=section.port,
        baud=section.baud,
        bytesize=section.bytesize,
        parity=section.parity,
        stopbits=section.stopbits,
    )


def _sections(survey: Survey) -> dict[str, SerialSection | None]:
    return {"laser": survey.laser, "head": survey.head, "air": survey.air_sensor}


def _address(survey: Survey, name: str) -> str:
    if name == "machine":
        return machine_settings(survey.plc).address
    section = _sections(survey)[name]
    if section is None:
        return ""
    return (
        section.port
        if network_line(section.port) is not None
        else f"{section.port}, {section.baud} baud"
    )
