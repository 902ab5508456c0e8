"""Recognition of instruments on serial ports, and of controls by queries in their protocols.

Nothing is written to a machine. An instrument that sends only on request receives a request for a
reading.
"""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import Words
from stepdiag.base.settings import convert, read_toml
from stepdiag.daq.formats.instruments.ids3010 import Ids3010Settings
from stepdiag.daq.formats.instruments.lasertex import LasertexSettings
from stepdiag.daq.formats.instruments.nd import NdSettings
from stepdiag.daq.formats.instruments.qudis import QudisSettings
from stepdiag.daq.formats.instruments.umd.decoder import UmdSettings
from stepdiag.daq.formats.recognise import recognise
from stepdiag.daq.formats.registry import FormatSettings, make_decoder
from stepdiag.daq.formats.signals import SignalDecoder, Signals, plan_reads
from stepdiag.daq.links.controls.machine import open_machine
from stepdiag.daq.links.ports.address import network_line
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.serial import instrument_line
from stepdiag.daq.links.ports.tty import present_ports
from stepdiag.daq.recording.survey_links import machine_settings
from stepdiag.daq.survey.composed import plc_section
from stepdiag.daq.survey.models import Plc

PROBED = ("modbus", "siemens-828d", "heidenhain")
ANSWER_S = 10.0
"""Longest time in s for the answer of a control."""
_LOOK_S = 0.1
_NETWORK_PORTS = {9090: "ids3010", 2101: "qudis"}
_SPEAKERS: dict[str, FormatSettings] = {
    "umd": UmdSettings(),
    "ids3010": Ids3010Settings(),
    "qudis": QudisSettings(),
    "lasertex": LasertexSettings(),
    "nd": NdSettings(),
}


@dataclass(frozen=True, slots=True)
class PortSeen:
    """A serial port of this computer: its name, and the name of its adapter in ``words``."""

    name: str
    words: str


@dataclass(frozen=True, slots=True)
class Heard:
    """The bytes received on a port: their format (empty if unknown), the baud rate, the first
    bytes, and the reason of a failure."""

    format: str
    baud: int
    data: bytes
    trouble: Words = ""


@dataclass(frozen=True, slots=True)
class Answered:
    """The answer of a host in the protocol of a control: its signals, or the reason why they are
    missing."""

    control: str
    signals: Signals | None
    words: str


def ports() -> list[PortSeen]:
    """Return the serial ports of this computer with a connected device, by their stable names
    (``by-id``) if these exist."""
    return [PortSeen(name, words) for name, words in present_ports().items()]


async def listen(port: str, baud: int, seconds: float) -> Heard:
    """Listen on a port until an instrument is recognised. ``baud`` 0 tries the usual rates;
    ``seconds`` is the time for each combination of format and rate."""
    last = Heard("", baud, b"")
    for name, rate in _ways(port, baud):
        last = await _heard(port, name, rate, seconds, last)
        if last.format or last.trouble:
            break
    return last


async def probe(host: str, tcp_port: int, controls: Sequence[str] = PROBED) -> list[Answered]:
    """Query a host for the signals of ``controls``, one protocol after another; ``tcp_port`` 0
    tries the usual ports.

    The queries are sequential: loading a library stops the event loop, and a simultaneous answer
    would count as late. A given port has a single protocol, so the first control that answers ends
    the search.
    """
    answered: list[Answered] = []
    for control in controls:
        answered.append(await _asked(control, host, tcp_port))
        if tcp_port and answered[-1].signals is not None:
            break
    return answered


def _ways(port: str, baud: int) -> Iterator[tuple[str, int]]:
    line = network_line(port)
    if line is not None:
        first = _NETWORK_PORTS.get(line.port, "umd")
        yield from (
            (name, 115200) for name in (first, *(each for each in _SPEAKERS if each != first))
        )
        return
    yield "umd", baud or 115200
    yield "lasertex", baud or 3_000_000
    yield "nd", baud or 115200
    if not baud:
        yield "nd", 9600


async def _heard(port: str, name: str, baud: int, seconds: float, before: Heard) -> Heard:
    chunks: list[bytes] = []
    line = instrument_line(
        SerialSettings(port=port, baud=baud),
        make_decoder(name, _SPEAKERS[name]),
        lambda data, _: chunks.append(data),
    )
    session = asyncio.create_task(line.session(lambda *_: None))
    loop, found = asyncio.get_running_loop(), ""
    end = loop.time() + seconds
    while loop.time() < end and not found and not session.done():
        await asyncio.wait({session}, timeout=_LOOK_S)
        found = recognise(b"".join(chunks))
    trouble: Words = ""
    session.cancel()
    try:
        await session
    except DeviceError as error:
        trouble = error.message
    except asyncio.CancelledError:
        pass
    return Heard(found, baud, b"".join(chunks) or before.data, "" if found else trouble)


async def _asked(control: str, host: str, tcp_port: int) -> Answered:
    plc = convert(
        read_toml(f"[plc]\n{plc_section(control, host, tcp_port)}", control)["plc"],
        Plc,
        control,
    )
    plc = msgspec.structs.replace(plc, timeout_s=ANSWER_S)
    reads = plan_reads(plc.signals, () if plc.transport == "s7" else plc.standing)
    settings = machine_settings(plc)
    try:
        link = await open_machine(settings, reads)
    except DeviceError as error:
        return Answered(control, None, str(error))
    try:
        block = await link.read()
        signals = SignalDecoder(plc.signals, plc.parsed()).decode(block)
    except DeviceError as error:
        return Answered(control, None, str(error))
    finally:
        link.close()
        await asyncio.sleep(0)
    values = ", ".join(
        f"{name} {getattr(signals, name)}"
        for name in plc.signal_names
        if getattr(signals, name) is not None
    )
    return Answered(
        control,
        signals,
        "; ".join([f"{settings.address}: {values}", *map(str, link.refusals.values())]),
    )
