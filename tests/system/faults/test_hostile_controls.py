"""Controls over S7 and LSV2 that somebody else plays: whatever comes is an answer or a trouble with
the link, never another exception."""

import asyncio
import math
import random
import socket
import struct
import threading
from contextlib import contextmanager, suppress

import pytest

from stepdiag.base.errors import DeviceError
from stepdiag.daq.links.controls import lsv2, s7
from stepdiag.daq.records.events import ReadRange
from testkit.running.controls import s7_control, telegram, tnc_control

pytestmark = pytest.mark.system

S7_RANGES = [
    ReadRange("db4900", 0, 6),
    *(ReadRange(f"db390{axis}", 0, 1) for axis in range(3)),
]
TNC_RANGES = [ReadRange("B", 280, 8), ReadRange("B", 1026, 1)]
CONNECTIONS, READS = 60, 3
OPENING = {"s7": 2, "lsv2": 12}
"""Answers until the first read; half of the connections are let through to it unchanged."""
ANSWER_S = 0.2
REACHED = 16_000_000
"""Bytes that may reach a program that gave up after one million: what lies in the buffers of two
sockets is sent, not read."""


@contextmanager
def between(port, opening, dice):
    """Stand between program and control; yield the port. The control's answers are changed from the
    first on, or from the first read."""
    listener, threads = socket.create_server(("127.0.0.1", 0)), []

    def carry(source, target, changing, first):
        answers = 0
        with suppress(OSError):
            while data := source.recv(65536):
                answers += 1
                target.sendall(spoilt(data, changing) if answers > first else data)
        for each in (source, target):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def both_ways(near, far, changing, first):
        with near, far:
            back = threading.Thread(target=carry, args=(far, near, changing, first))
            back.start()
            carry(near, far, changing, math.inf)
            back.join()

    def accept():
        with suppress(OSError):
            while True:
                near, far = (
                    listener.accept()[0],
                    socket.create_connection(("127.0.0.1", port)),
                )
                threads.append(
                    threading.Thread(
                        target=both_ways,
                        args=(
                            near,
                            far,
                            random.Random(dice.random()),
                            dice.choice((0, opening)),
                        ),
                    )
                )
                threads[-1].start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for each in threads:
            each.join()


def spoilt(data, dice):
    """Return bytes with some changed, lost or too many."""
    found = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 4))):
        place = dice.randrange(len(found)) if found else 0
        match dice.choice(("changed", "changed", "lost", "added", "after")):
            case "changed" if found:
                found[place] = dice.choice((0, 1, 0x7F, 0x80, 0xFF, dice.randrange(256)))
            case "lost":
                del found[place : place + dice.randrange(1, 6)]
            case "added":
                found[place:place] = dice.randbytes(dice.randrange(1, 6))
            case _:
                found += dice.randbytes(20)
    return bytes(found)


@pytest.mark.parametrize("name", OPENING)
def test_changed_answers_are_answers_or_troubles(name, monkeypatch):
    monkeypatch.setattr({"s7": s7, "lsv2": lsv2}[name], "CONNECT_S", 1.0)
    control = s7_control if name == "s7" else tnc_control
    with control() as running, between(running.port, OPENING[name], random.Random(5)) as port:
        heard = asyncio.run(_all_heard(name, port))
    assert heard["trouble"] > 0
    assert heard["read"] > 0, "nothing was read: the changed bytes never came to be judged"


async def _all_heard(name, port):
    counts = {"read": 0, "trouble": 0}
    for _ in range(CONNECTIONS // 10):
        for told in await asyncio.gather(*(_heard(name, port) for _ in range(10))):
            for each in told:
                counts[each] += 1
    return counts


async def _heard(name, port):
    """Return what came of one connection and a few reads; what is raised besides a trouble with the
    link is raised here."""
    told = []
    link = None
    for _ in range(READS):
        try:
            link = link or await _opened(name, port)
            await link.read()
            told.append("read")
        except DeviceError:
            told.append("trouble")
            if link is None:
                break
    if link is not None:
        link.close()
    return told


async def _opened(name, port):
    if name == "s7":
        return await s7.open_link(
            s7.S7Settings(host="127.0.0.1", port=port, timeout_s=ANSWER_S), S7_RANGES
        )
    return await lsv2.open_link(
        lsv2.Lsv2Settings(host="127.0.0.1", port=port, timeout_s=ANSWER_S), TNC_RANGES
    )


def test_an_answer_without_end_is_given_up_and_never_kept():
    """A network brings gigabytes while a poll waits; the unit has two, and ends what asks for
    more."""
    listener = socket.create_server(("127.0.0.1", 0))
    sent = 0

    def serve():
        nonlocal sent
        connection = listener.accept()[0]
        with connection, suppress(OSError):
            while len(request := connection.recv(4096)) >= 8:
                if request[4:8] == b"R_VR":
                    connection.sendall(struct.pack(">L", 0xFFFFFFFF) + b"S_VR")
                    while True:
                        sent += connection.send(bytes(65536))
                connection.sendall(telegram("T_OK"))

    thread = threading.Thread(target=serve)
    thread.start()
    with pytest.raises(DeviceError, match="an answer of more than 1000000 bytes"):
        asyncio.run(_opened("lsv2", listener.getsockname()[1]))
    thread.join(60)
    listener.close()
    assert not thread.is_alive()
    assert sent < REACHED
