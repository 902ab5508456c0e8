"""`stepdiag publish --broker` and brokers that mean it harm: it computes little, keeps little, and
tells the next honest one everything."""

import asyncio
import hashlib
import os
import random
import signal
import struct
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from testkit.fleets import finished_survey
from testkit.hostile.foreign_logs import SURVEY

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

WELCOME = b"\x20\x02\x00\x00"
"""CONNACK of MQTT 3.1.1: come in."""
MEMORY_KB, CPU_S = 60_000, 15.0
"""What all of them together may cost: seconds are of computing, of which looking five times a
second takes some as long as it lasts."""


HURRIED = (
    "from stepdiag.__main__ import main; from stepdiag.publish import mqtt; mqtt.FIRST_WAIT_S, "
    "mqtt.ANSWER_S = 0.1, 3.0; main()"
)
"""The program, but that it gives up sooner, and comes back sooner."""


async def garbage(_reader, writer):
    dice = random.Random(3)
    while True:
        writer.write(dice.randbytes(65536))
        await writer.drain()


async def endless_packet(_reader, writer):
    """One message of 268 MB, as much as the protocol allows."""
    writer.write(WELCOME + b"\x30\xff\xff\xff\x7f")
    while True:
        writer.write(bytes(1 << 20))
        await writer.drain()


async def never_released(_reader, writer):
    """Messages at most once, none of which is ever released: each must be kept."""
    writer.write(WELCOME)
    for number in range(1, 65536):
        writer.write(b"\x34\x85\x40\x00\x01a" + struct.pack(">H", number) + bytes(8192))
        await writer.drain()


async def flood(_reader, writer):
    """Answers to questions that nobody asked."""
    writer.write(WELCOME)
    while True:
        writer.write(b"\xd0\x00" * 32768)
        await writer.drain()


async def malformed(_reader, writer):
    """Acknowledgements that end too early."""
    writer.write(WELCOME + b"\x40\x01\x00" + b"\x62\x00" + b"\x90\x00" * 100)
    await asyncio.sleep(1)


async def drop(_reader, writer):
    writer.write(WELCOME)


async def deaf(_reader, writer):
    """Takes what comes and acknowledges nothing, for a while."""
    writer.write(WELCOME)
    await asyncio.sleep(1)


HOSTILE = (garbage, endless_packet, never_released, flood, malformed, drop, deaf)


class Brokers:
    """A port behind which every connection finds another broker: the hostile ones by turns, then an
    honest one."""

    def __init__(self):
        self.met, self.heard, self.port = [], set(), 0
        self._loop, self._begun = asyncio.new_event_loop(), threading.Event()
        self._thread = threading.Thread(
            target=self._loop.run_until_complete, args=(self._serve(),)
        )

    def __enter__(self):
        self._thread.start()
        assert self._begun.wait(60)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(60)
        self._loop.close()

    async def _serve(self):
        self._end = asyncio.Event()
        server = await asyncio.start_server(self._meet, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._begun.set()
        await self._end.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for each in others:
            each.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _meet(self, reader, writer):
        broker = HOSTILE[len(self.met)] if len(self.met) < len(HOSTILE) else self._honest
        self.met.append(broker.__name__)
        with suppress(OSError, asyncio.IncompleteReadError):
            await broker(reader, writer)
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()

    async def _honest(self, reader, writer):
        writer.write(WELCOME)
        while True:
            kind, size, shift = (await reader.readexactly(1))[0], 0, 0
            while (byte := (await reader.readexactly(1))[0]) & 128:
                size, shift = size | (byte & 127) << shift, shift + 7
            body = await reader.readexactly(size | byte << shift)
            if kind & 0xF0 == 0x30:
                end = 2 + struct.unpack(">H", body[:2])[0]
                self.heard.add(body[2:end].decode().rpartition("/")[2])
                writer.write(b"\x40\x02" + body[end : end + 2])


def used(pid):
    """Return seconds of computing and the most memory in kB so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    memory = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK"), memory


def files_of(folder):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


async def until(look):
    async with asyncio.timeout(300):
        while not look():  # noqa: ASYNC110  # what another thread writes
            await asyncio.sleep(0.05)


def test_hostile_brokers_cost_little_and_the_next_honest_one_hears_everything(tmp_path):
    finished_survey(tmp_path / "bench")
    survey = tmp_path / "mill.toml"
    survey.write_text(SURVEY[: SURVEY.index("[[export]]")])
    before = files_of(tmp_path)
    with Brokers() as brokers, (tmp_path.parent / f"{tmp_path.name}.log").open("wb") as log:
        command = [
            sys.executable,
            "-c",
            HURRIED,
            "publish",
            survey,
            "--plain",
            "--broker",
            f"127.0.0.1:{brokers.port}",
            "--every",
            "0.2",
        ]
        process = subprocess.Popen([*map(str, command)], stdout=log, stderr=log)
        try:
            asyncio.run(until(lambda: brokers.met or process.poll() is not None))
            begun_s, begun_kb = used(process.pid)
            asyncio.run(
                until(
                    lambda: (
                        brokers.heard == {"online", "state", "findings", "result"}
                        or process.poll() is not None
                    )
                )
            )
            ended_s, ended_kb = used(process.pid)
            assert brokers.met[: len(HOSTILE)] == [each.__name__ for each in HOSTILE]
            assert ended_kb < begun_kb + MEMORY_KB
            assert ended_s < begun_s + CPU_S
            process.send_signal(signal.SIGTERM)
            assert process.wait(60) == 0
        finally:
            if process.poll() is None:
                process.kill()
                process.wait(60)
    assert files_of(tmp_path) == before
