"""Lines on the network over real sockets: the same chunks and stamps as a serial port, lost, silent
and back again."""

import asyncio
import socket
import threading
from pathlib import Path

import pytest

from stepdiag.base.errors import DeviceError
from stepdiag.daq.links.ports import network, serial
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.serial import PolledSerial, SerialStream
from stepdiag.daq.links.reconnect import Reconnector
from stepdiag.daq.timing.host_clock import now_ns
from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.slaves import Pty, running, wait_until
from testkit.running.terminal_server import terminal_server


@pytest.fixture
def pty():
    line = Pty()
    yield line
    line.close()


async def while_running(session, work):
    task = asyncio.create_task(session(lambda *_: None))
    try:
        await asyncio.to_thread(work)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def stream_of(name, chunks, **more):
    return SerialStream(
        SerialSettings(port=name), lambda *chunk: chunks.append(chunk), **more
    )


def descriptors():
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def refusal(name):
    with pytest.raises(DeviceError) as refused:
        asyncio.run(asyncio.wait_for(stream_of(name, []).session(lambda *_: None), 60.0))
    return str(refused.value)


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_every_byte_arrives_in_order_with_a_stamp_of_the_moment_both_ways(pty, scheme):
    """All 256 values, the escape byte of Telnet among them; what is written arrives as it was
    written."""
    chunks, sent = [], [bytes(range(256)) * 2, b"\xff" * 300, bytes([255, 240, 250, 44]) * 40]

    def heard():
        return b"".join(data for data, _ in chunks)

    with terminal_server(pty.name, scheme) as name:
        greeting = bytes(range(256))

        def work():
            told = bytearray()
            wait_until(lambda: told.extend(pty.read(0.1)) or len(told) >= 256)
            assert bytes(told) == greeting
            for block in sent:
                before_ns, whole = now_ns(), len(heard()) + len(block)
                pty.write(block)
                wait_until(lambda whole=whole: len(heard()) == whole)
                assert before_ns - 1000 <= chunks[-1][1] <= now_ns()

        asyncio.run(while_running(stream_of(name, chunks, greeting=greeting).session, work))
    assert heard() == b"".join(sent)


def test_a_terminal_server_that_restarts_is_found_again(pty):
    """The connection ends, nobody is there for a moment, and the line goes on."""
    states, chunks, port = [], [], reserved_port()

    async def run():
        with terminal_server(pty.name, "socket", port) as name:
            keeping = Reconnector(
                "laser",
                stream_of(name, chunks).session,
                lambda state, *_: states.append(state),
            )
            task = asyncio.create_task(keeping.run())
            await asyncio.to_thread(wait_until, lambda: "connected" in states)
        await asyncio.to_thread(wait_until, lambda: "lost" in states)
        with socket.create_server(("127.0.0.1", port)) as listener:
            guest, _ = await asyncio.to_thread(listener.accept)
            guest.sendall(b"here again")
            await asyncio.to_thread(
                wait_until, lambda: b"here again" in b"".join(data for data, _ in chunks)
            )
            guest.close()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    assert states[:3] == ["connecting", "connected", "lost"]


def test_an_instrument_behind_a_terminal_server_is_asked_and_answers(pty, monkeypatch):
    monkeypatch.setattr(serial, "ANSWER_TIMEOUT_S", 60.0)
    chunks = []

    def work():
        for number in range(3):
            wait_until(lambda: b"?" in pty.read(1.0))
            pty.write(b"%d\r" % number)
            wait_until(lambda number=number: len(chunks) > number)

    with terminal_server(pty.name, "socket") as name:
        line = PolledSerial(
            SerialSettings(port=name),
            lambda *chunk: chunks.append(chunk),
            request=b"?",
            interval_s=0.01,
        )
        asyncio.run(while_running(line.session, work))
    assert [data for data, _ in chunks][:3] == [b"0\r", b"1\r", b"2\r"]


def test_several_things_are_asked_for_at_their_own_pace(pty):
    """The reading at every turn, the air ten times less often; a greeting before everything."""
    heard = []

    def answered():
        for request in pty.read(0.05).split(b";")[:-1]:
            heard.append(request)
            pty.write(b"ok\r")
        return heard.count(b"a") >= 3

    def work():
        wait_until(answered)

    line = PolledSerial(
        SerialSettings(port=pty.name),
        lambda *_: None,
        request=b"r;",
        interval_s=0.01,
        others=[(b"a;", 0.2)],
        greeting=b"hello;",
    )
    asyncio.run(while_running(line.session, work))
    assert heard[0] == b"hello"
    assert heard.count(b"r") >= heard.count(b"a")


def test_a_closed_port_an_unknown_name_and_silence_are_told_apart(monkeypatch):
    port = reserved_port()
    assert (
        "found Connection refused; the host answers, but nothing listens on this port"
        in refusal(f"socket://127.0.0.1:{port}")
    )
    assert "found no such name; check the name of the host" in refusal(
        "socket://no-such-host.invalid:4001"
    )
    monkeypatch.setattr(network, "CONNECT_S", 0.3)
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen(0)
        name = f"socket://127.0.0.1:{deaf.getsockname()[1]}"
        full = [socket.socket() for _ in range(3)]
        for each in full:
            each.setblocking(False)
            each.connect_ex(deaf.getsockname())
        said = refusal(name)
        for each in full:
            each.close()
    assert "found silence for 0.3 s; the host sends neither an answer nor a refusal" in said


def test_a_server_of_plain_bytes_is_not_taken_for_one_that_speaks_rfc_2217(monkeypatch):
    """Its bytes come before the time is up: at once, on a busy computer later."""
    for agree_s in (0.3, 3.0, 10.0):
        monkeypatch.setattr(network, "AGREE_S", agree_s)
        with socket.create_server(("127.0.0.1", 0)) as listener:
            name = f"rfc2217://127.0.0.1:{listener.getsockname()[1]}"

            def work(ended, listener=listener):
                guest, _ = listener.accept()
                with guest:
                    guest.sendall(b"+000.123\r\n")
                    ended.wait()

            with running(work):
                said = refusal(name)
        if "found silence" not in said:
            break
    assert (
        "expected a terminal server that speaks RFC 2217, found bytes of another protocol (2b 30 "
        "30 30 2e" in said
    )
    assert "use socket:// instead of rfc2217://" in said


def test_no_thread_and_no_descriptor_is_left(pty):
    before = descriptors()
    with terminal_server(pty.name, "rfc2217") as name:
        chunks = []

        def work():
            pty.write(b"x")
            wait_until(lambda: pty.write(b"x") is None and bool(chunks))

        for _ in range(3):
            asyncio.run(while_running(stream_of(name, chunks).session, work))
    assert not [
        thread for thread in threading.enumerate() if thread.name.startswith("serial ")
    ]
    assert descriptors() <= before


def test_a_line_that_never_falls_silent_is_no_instrument_that_is_asked(pty, monkeypatch):
    """An answer came late, or never; what speaks on afterwards was thrown away for ever, and nobody
    heard of it."""
    monkeypatch.setattr(serial, "ANSWER_TIMEOUT_S", 0.5)
    monkeypatch.setattr(serial, "NEVER_SILENT_S", 0.2)

    def speaks(ended):
        while not ended.wait(0.02):
            pty.write(b"login: ")

    line = PolledSerial(
        SerialSettings(port=pty.name),
        lambda *_: None,
        request=b"?",
        interval_s=0.01,
        greeting=b"hello",
    )
    with (
        running(speaks),
        pytest.raises(
            DeviceError,
            match="expected a line that is silent until a request is sent, found a line that",
        ),
    ):
        asyncio.run(asyncio.wait_for(line.session(lambda *_: None), 60.0))
