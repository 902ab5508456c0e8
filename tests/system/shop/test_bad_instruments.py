"""What stands at the end of an instrument's line and is not that instrument: named with what was
seen, by `check` and in the journal.

Every row is watched by both at once, all rows together: waiting costs nothing. None of them may
ever give a reading.
"""

import asyncio
import json
import math
import os
import random
import socket
import struct
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass

import pytest
import structlog
from structlog.contextvars import bind_contextvars, merge_contextvars
from structlog.testing import capture_logs

from stepdiag.checking.check import Observation, watch
from stepdiag.checking.diagnosis import diagnose
from stepdiag.daq.service.daemon import Daemon
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.slaves import Pty

pytestmark = pytest.mark.system

PATIENCE_S = 90.0
AT_ONCE = 24
EVERY_S = 0.05
BASE = """
[survey]
name = "s"
machine = "m"
[volume]
size_mm = [500, 400, 300]
increments = 10
[plc]
transport = "none"
"""
LASER = '{base}[environment]\nsource = "fixed"\n[laser]\nport = "{port}"\n{section}'
NO_LASER = '{base}[laser]\nformat = "umd"\nport = "/dev/no-laser"\n'
HEAD = NO_LASER + '[environment]\nsource = "fixed"\n[head]\nport = "{port}"\n{section}'
AIR = (
    NO_LASER
    + '[environment]\nsource = "sensor"\n[environment.sensor]\nport = "{port}"\n{section}'
)
ANGLES = '[head.angles]\nx = ["+C", "+B"]\n'
FRAMES = (
    'format = "frames"\n[laser.frames]\nsync = "AA55"\nlayout = ["counter u16", "position '
    'i32"]\nchecksum = "crc-16/modbus"\n'
)
INSTRUMENTS = {
    "umd": ("laser", LASER, 'format = "umd"'),
    "nd": ("laser", LASER, 'format = "nd"'),
    "line": (
        "laser",
        LASER,
        (
            'format = "line"\n[laser.line]\npattern = '
            "'D:(?P<position>[-+.0-9]+);(?P<counter>[0-9]+)'"
        ),
    ),
    "frames": ("laser", LASER, FRAMES),
    "ids3010": ("laser", LASER, 'format = "ids3010"'),
    "lasertex": ("laser", LASER, 'format = "lasertex"'),
    "qudis": ("laser", LASER, 'format = "qudis"'),
    "fourdof": ("head", HEAD, 'format = "fourdof"'),
    "tqd": ("head", HEAD, 'format = "tqd"'),
    "elcomat": ("head", HEAD, f'format = "elcomat"\n{ANGLES}'),
    "wyler": ("head", HEAD, 'format = "wyler"\n[head.angles]\nx = ["+A"]\n'),
    "ptu300": ("air", AIR, 'format = "ptu300"'),
    "logger": (
        "air",
        AIR,
        "format = \"line\"\npattern = '(?P<air_temperature_c>[^;]+);(?P<air_pressure_hpa>[^;]+)'",
    ),
}
NOISE = random.Random(7).randbytes(100_000)


def says(data):
    """A peer that says this again and again, whatever it is told."""

    async def peer(_, writer):
        while True:
            writer.write(data)
            await writer.drain()
            await asyncio.sleep(EVERY_S)

    return peer


def noise():
    async def peer(_, writer):
        at = 0
        while True:
            writer.write(NOISE[at % 90_000 :][:150])
            at += 150
            await writer.drain()
            await asyncio.sleep(EVERY_S)

    return peer


def answers(answer):
    """A peer that answers what it hears; with nothing, where ``answer`` gives nothing."""

    async def peer(reader, writer):
        while heard := await reader.read(65536):
            writer.write(answer(heard))
            await writer.drain()

    return peer


async def hangs_up(*_):
    return


def rpc(**said):
    """Return what answers every request of JSON-RPC with this."""
    return answers(
        lambda heard: (
            json.dumps({"jsonrpc": "2.0", "id": json.loads(heard)["id"], **said}).encode()
            + b"\r\n"
        )
    )


def hpi(code, data, *, broken=0):
    frame = b"\xaa" + struct.pack(">H", code) + data.ljust(12, b"\0")
    register = 0xFF
    for byte in frame:
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ (0x31 if register & 0x80 else 0)) & 0xFF
    return frame + bytes([register ^ broken])


def qudis(opcode, address, *data, correlation=0):
    return struct.pack(
        f"<{5 + len(data)}I", 16 + 4 * len(data), opcode, address, 0, correlation, *data
    )


READING = qudis(4, 0x0F00, 123456, 1 << 31)


async def has_one_axis(reader, writer):
    """A quDIS that goes on with source 1 whatever is set."""
    await reader.read(65536)
    await says(qudis(3, 0x0031, 0, 1, correlation=1) + READING)(reader, writer)


HALVES = {
    "umd": b"123456 789",
    "nd": b"\x02+0000",
    "line": b"D:12.3",
    "frames": b"\xaa\x55\x01",
    "ids3010": b'{"jsonrpc":"2.0","id":1,"resu',
    "lasertex": hpi(0xB015, b"\0" * 7)[:9],
    "qudis": qudis(4, 0x0F00, 1, 2)[:12],
    "fourdof": b"\xaa\x55",
    "tqd": b"X: 0.1",
    "elcomat": b"3 003 1.",
    "wyler": b"0 0.",
    "ptu300": b"P= 1013",
    "logger": b"21.",
}
NETWORK = {
    "closed": (None, "nothing listens on this port", ""),
    "unknown": (None, "no such name", ""),
    "firewall": (None, "neither an answer nor a refusal", ""),
    "silence": (answers(lambda _: b""), "no byte for", ""),
    "hangs up": (hangs_up, "expected a port that stays open, found the port is gone", ""),
    "another product": (says(b"login: \r\n"), "cannot be decoded", "6c 6f 67 69 6e"),
    "noise": (noise(), "cannot be decoded", "they begin with"),
}


@dataclass(frozen=True)
class Row:
    """What stands there; what is to be said of it, and what was seen, by both; ``section`` where
    the survey has another one."""

    instrument: str
    wrong: str
    peer: object
    words: str
    seen: str = ""
    section: str = ""
    scheme: str = "socket"

    @property
    def name(self):
        return f"{self.instrument}: {self.wrong}"


ROWS = [
    *(Row(name, wrong, *row) for name in INSTRUMENTS for wrong, row in NETWORK.items()),
    *(
        Row(
            name,
            "half a reading for ever",
            says(half),
            "cannot be decoded",
            half[:4].hex(" "),
        )
        for name, half in HALVES.items()
    ),
    *(
        Row(
            name,
            "wrong baud rate",
            noise(),
            "check baud rate",
            "they begin with",
            scheme="serial",
        )
        for name in ("umd", "nd", "line", "lasertex", "elcomat", "ptu300")
    ),
    Row(
        "umd",
        "no terminal server of RFC 2217",
        says(b"+000.123\r\n"),
        "speaks RFC 2217",
        "2b 30 30 30",
        scheme="rfc2217",
    ),
    Row(
        "umd",
        "a terminal server that says nothing",
        answers(lambda _: b""),
        "speaks RFC 2217",
        "silence",
        scheme="rfc2217",
    ),
    Row(
        "umd",
        "another laser",
        says(hpi(0xB015, b"\0" * 7)),
        'the data look like format = "lasertex"',
        "aa b0 15",
    ),
    Row(
        "lasertex",
        "frames with wrong checksums",
        says(hpi(0xB015, b"\x01" * 7, broken=1)),
        "cannot be decoded",
        "aa b0 15",
    ),
    Row(
        "frames",
        "frames with wrong checksums",
        says(b"\xaa\x55\x01\x00\x01\x02\x03\x04\xff\xff"),
        "cannot be decoded",
        "aa 55 01",
    ),
    Row(
        "frames",
        "another byte in front",
        says(b"\xaa\x56" + bytes(8)),
        "cannot be decoded",
        "aa 56",
    ),
    Row(
        "ids3010",
        "errors alone",
        rpc(error={"code": -32000, "message": "Laser off"}),
        "no reading can be used",
        "Laser off",
    ),
    Row(
        "ids3010",
        "other firmware",
        rpc(error={"code": -32601, "message": "Method not found"}),
        "laser.ids3010.interface",
        "not found",
    ),
    Row(
        "ids3010",
        "numbers of something else",
        rpc(result=[0, 1]),
        "no reading can be used",
        '"result": [0',
    ),
    Row(
        "ids3010",
        "no answer of this protocol",
        answers(lambda _: b'{"status": "ok"}\r\n'),
        "cannot be decoded",
        "status",
    ),
    Row(
        "qudis",
        "readings of another channel",
        says(qudis(4, 0x0F01, 1, 1 << 31)),
        "channel 1",
        "only channel 0 was requested",
    ),
    Row(
        "qudis",
        "an axis that it has not",
        has_one_axis,
        "source 1",
        "requested source 5",
        section="[laser.qudis]\naxis = 3",
    ),
    Row(
        "qudis",
        "positions not in pairs",
        says(qudis(4, 0x0F00, 1, 2, 3)),
        "cannot be decoded",
        "do not form pairs",
    ),
    Row(
        "nd",
        "a display that refuses",
        answers(lambda _: b"\x15"),
        "no reading can be used",
        "NAK",
    ),
    Row(
        "nd",
        "text in the place of a value",
        answers(lambda _: b"\x02ERROR 3\r\n"),
        "no reading can be used",
        "ERROR 3",
    ),
    Row(
        "elcomat", "relative readings", says(b"1 003 1.0 2.0\r"), "cannot be decoded", "1 003"
    ),
    Row(
        "ptu300",
        "probes that fail",
        answers(lambda _: b"P= ****** hPa T= ***** 'C RH= ***** %RH\r\n"),
        "no reading can be used",
        "error",
    ),
]


@asynccontextmanager
async def served(peer):
    """Serve a peer to whoever comes; yield the port."""
    guests = set()

    async def guest(reader, writer):
        guests.add(asyncio.current_task())
        try:
            with suppress(OSError):
                await peer(reader, writer)
        except asyncio.CancelledError:
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(guest, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for each in guests:
            each.cancel()
        await asyncio.gather(*guests, return_exceptions=True)


@asynccontextmanager
async def standing(row):
    """Have it stand there; yield how a survey file names the port."""
    async with AsyncExitStack() as stack:
        if row.scheme == "serial":
            line = Pty()
            stack.callback(line.close)
            os.set_blocking(line.far, False)
            shouting = asyncio.create_task(_shouting(line))
            stack.callback(shouting.cancel)
            yield line.name
        elif row.wrong == "unknown":
            yield "socket://no-such-instrument.invalid:4001"
        elif row.wrong == "closed":
            yield f"socket://127.0.0.1:{reserved_port()}"
        elif row.wrong == "firewall":
            deaf = stack.enter_context(socket.create_server(("127.0.0.1", 0), backlog=0))
            for _ in range(4):
                one = stack.enter_context(socket.socket())
                one.setblocking(False)
                one.connect_ex(deaf.getsockname())
            yield f"socket://127.0.0.1:{deaf.getsockname()[1]}"
        else:
            port = await stack.enter_async_context(served(row.peer))
            yield f"{row.scheme}://127.0.0.1:{port}"


async def _shouting(line):
    at = 0
    while True:
        with suppress(BlockingIOError):
            at += os.write(line.far, NOISE[at % 90_000 :][:150])
        await asyncio.sleep(EVERY_S)


def survey_of(row, port):
    _, text, section = INSTRUMENTS[row.instrument]
    return text.format(base=BASE, port=port, section=f"{section}\n{row.section}\n")


async def checked(row, port):
    """Return what `check` says of the stream once it says what it should, or after a long time; and
    what it has seen."""
    seen = Observation(parse_survey(survey_of(row, port), "s"))
    name = INSTRUMENTS[row.instrument][0]
    told = []

    def until_it_is_said():
        told[:] = [
            each.text
            for each in diagnose(seen)
            if _of(each, name) and each.severity == "error"
        ]
        if any(row.words in text and row.seen in text for text in told):
            seen.seconds = math.inf

    await watch(seen, PATIENCE_S, until_it_is_said)
    return "; ".join(told), next(
        stream for stream in seen.streams if stream.link.name == name
    )


def _of(found, name):
    """Return whether a finding is one of a stream: its code begins with the name, or the subject of
    its sentence is the stream."""
    return found.code.startswith(name) or name in found.text[:40]


async def journal(row, port, folder, said):
    """Return what the journal of a daemon says of the stream once it says what it should, or after
    a long time; and its readings.

    (Between two logs a daemon decodes laser and sensor of air; a head only while it records.)
    """
    file = folder / "survey.toml"
    file.write_text(survey_of(row, port))
    bind_contextvars(row=row.name)
    daemon = Daemon(file, completion=("true",))
    running = asyncio.create_task(daemon.run())
    name, end = INSTRUMENTS[row.instrument][0], asyncio.get_running_loop().time() + PATIENCE_S

    def heard():
        """Of a line that is lost the row is known; what an instrument says comes in from a thread,
        and is that of this daemon's session."""
        links = [
            str(each["detail"])
            for each in said
            if each.get("row") == row.name and each.get("link") == name and "detail" in each
        ]
        noted = {each["text"] for each in said if each["event"] == "finding"}
        found = daemon._working.session.findings if hasattr(daemon, "_working") else []
        return "; ".join(
            (*links, *(each.text for each in found if _of(each, name) and each.text in noted))
        )

    while (
        not (row.words in heard() and row.seen in heard())
        and asyncio.get_running_loop().time() < end
    ):
        await asyncio.wait({running}, timeout=0.1)
        assert not running.done()
    idle = daemon._working.session._idle.get(name)
    readings = (
        0 if idle is None else len(idle.span(0, math.inf).position_mm) + len(idle.conditions)
    )
    daemon.stop()
    await running
    return heard(), readings


async def both(row, folder, turn, said):
    """Return what is wrong with what is said of a row; nothing where all is well."""
    folder.mkdir()
    async with turn, standing(row) as port:
        if row.scheme == "serial":  # one program at a time
            (told, stream), (noted, readings) = (
                await checked(row, port),
                await journal(row, port, folder, said),
            )
        else:
            (told, stream), (noted, readings) = await asyncio.gather(
                checked(row, port), journal(row, port, folder, said)
            )
    wrong = [f"check: {told}"] if not (row.words in told and row.seen in told) else []
    wrong += [f"journal: {noted}"] if not (row.words in noted and row.seen in noted) else []
    wrong += [f"journal: {readings} readings"] if readings else []
    return wrong + (
        [f"{stream.samples} samples, {stream.refused} refused"]
        if stream.samples != stream.refused or stream.conditions
        else []
    )


async def all_of(rows, folder):
    turn = asyncio.Semaphore(AT_ONCE)
    with capture_logs(processors=[merge_contextvars]) as said:
        each = await asyncio.gather(
            *(both(row, folder / str(number), turn, said) for number, row in enumerate(rows))
        )
    return {row.name: wrong for row, wrong in zip(rows, each, strict=True) if wrong}


class TestWhateverStandsThere:
    """One table over all instruments."""

    def test_it_is_named_with_what_was_seen_and_gives_no_reading(self, tmp_path):
        structlog.reset_defaults()
        assert asyncio.run(all_of(ROWS, tmp_path)) == {}
