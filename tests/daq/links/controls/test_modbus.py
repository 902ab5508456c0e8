"""The machine's Modbus against literal wire bytes on loopback sockets."""

import asyncio
import struct
import threading
import time
from contextlib import suppress
from itertools import pairwise

import hypothesis
import pytest
from hypothesis import strategies as st
from structlog.testing import capture_logs

from stepdiag.base.errors import DeviceError
from stepdiag.daq.links.controls import poller
from stepdiag.daq.links.controls.modbus import (
    ModbusLink,
    TcpSettings,
    answer_within,
    open_link,
)
from stepdiag.daq.links.controls.modbus_errors import (
    LostConnectionError,
    RefusedRequestError,
    SilentDeviceError,
    StaleAnswerError,
    WrongUnitError,
)
from stepdiag.daq.links.controls.poller import MachinePoller
from stepdiag.daq.links.ports.lateness import Lateness
from stepdiag.daq.links.reconnect import Reconnector
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.timing.host_clock import now_ns
from testkit.running.slaves import TcpServer, wait_until

BLOCK = ReadRange("holding", 0, 3)


def registers(*values):
    """The data part of an answer with these registers."""
    return bytes([2 * len(values)]) + struct.pack(f">{len(values)}H", *values)


@pytest.fixture
def serve():
    servers = []

    def start(answer):
        servers.append(TcpServer(answer))
        return servers[-1]

    yield start
    for server in servers:
        server.stop()


def settings(server, timeout_s=60.0):
    """What is meant to come may take its time; only what is meant to fail is given a short one."""
    return TcpSettings(
        host="127.0.0.1", port=server.port, timeout_s=timeout_s, connect_s=60.0
    )


def ask(server, ranges, work=None, timeout_s=60.0):
    """Open a link, read one block (or do ``work`` with the link), close it; nothing is left
    running."""

    async def run():
        link = await open_link(settings(server, timeout_s), ranges)
        try:
            return await (work(link) if work else link.read())
        finally:
            link.close()
            await asyncio.sleep(0)
            assert asyncio.all_tasks() == {asyncio.current_task()}

    return asyncio.run(run())


def test_one_block_is_one_request_and_its_registers_are_the_wire_bytes(serve):
    asked = []

    def answer(pdu):
        asked.append(pdu)
        return b"\x03" + registers(0x0102, 0xFFFE, 7)

    before_ns = now_ns()
    block = ask(serve(answer), [BLOCK])
    assert asked == [b"\x03\x00\x00\x00\x03"]
    assert block.ranges == (BLOCK,)
    assert block.data == (b"\x01\x02\xff\xfe\x00\x07",)
    assert before_ns - 1000 <= block.send_ns <= block.recv_ns <= now_ns()


def test_every_table_has_its_function_code_and_bits_keep_their_order(serve):
    """Modbus Application Protocol V1.1b3, 6.1: the first coil is the least significant bit of the
    first byte."""
    bits = bytes.fromhex("cd6b05")
    asked = []

    def answer(pdu):
        asked.append(pdu[0])
        return bytes([pdu[0]]) + (b"\x03" + bits if pdu[0] < 3 else registers(9))

    ranges = [
        ReadRange("coil", 19, 19),
        ReadRange("discrete", 0, 19),
        ReadRange("holding", 5, 1),
        ReadRange("input", 6, 1),
    ]
    block = ask(serve(answer), ranges)
    assert asked == [1, 2, 3, 4]
    assert block.data == (bits, bits, b"\x00\x09", b"\x00\x09")


def test_a_refused_range_is_told_and_the_others_are_read(serve):
    def answer(pdu):
        return b"\x84\x02" if pdu[0] == 4 else b"\x03" + registers(1, 2, 3)

    other = ReadRange("input", 900, 2)

    async def work(link):
        return await link.read(), dict(link.refusals)

    block, refusals = ask(serve(answer), [BLOCK, other], work)
    assert block.data == (registers(1, 2, 3)[1:], b"")
    assert list(refusals) == [other]


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        (1, RefusedRequestError, "illegal function.*holding registers only"),
        (
            2,
            RefusedRequestError,
            "reading 3 entries of table holding from address 0.*illegal data address.*register map",
        ),
        (3, RefusedRequestError, "illegal data value"),
        (4, RefusedRequestError, r"device failure.*plc\.unit"),
        (10, WrongUnitError, r"gateway.*plc\.unit"),
        (11, WrongUnitError, r"gateway.*plc\.unit"),
        (99, RefusedRequestError, "exception 99"),
    ],
)
def test_an_exception_reply_says_what_to_do(serve, code, kind, words):
    with pytest.raises(kind, match=words):
        ask(serve(lambda pdu: bytes([pdu[0] | 0x80, code])), [BLOCK])


def test_a_silent_device_is_told_from_an_absent_one(serve):
    asked = []
    server = serve(asked.append)
    with pytest.raises(
        SilentDeviceError,
        match=r"an answer within 0.1 s, found silence.*program runs, and check the unit id",
    ):
        ask(server, [BLOCK], timeout_s=0.1)
    assert len(asked) == 1, "silence is told at once, not asked for again"
    server.stop()
    with pytest.raises(
        LostConnectionError,
        match=r"Connection refused; .*nothing listens on this port: check plc.port",
    ):
        ask(server, [BLOCK])
    server.start()


def test_a_late_answer_on_tcp_is_dropped_by_its_transaction_number(serve):
    values = iter(range(100))
    given_up = threading.Event()

    def answer(pdu):
        value = next(values)
        if value == 1:
            given_up.wait(30)
        return b"\x03" + registers(value, 0, 0)

    async def work(link):
        first = await link.read()
        answer_within(link._client, 0.1)
        with pytest.raises(SilentDeviceError):
            await link.read()
        answer_within(link._client, 60.0)
        given_up.set()
        return [first, *[await link.read() for _ in range(2)]]

    blocks = ask(serve(answer), [BLOCK], work)
    assert [struct.unpack(">3H", block.data[0])[0] for block in blocks] == [0, 2, 3]


def test_an_answer_of_another_length_is_not_believed(serve):
    with pytest.raises(StaleAnswerError):
        ask(serve(lambda pdu: b"\x03" + registers(1, 2)), [BLOCK])


@hypothesis.settings(
    max_examples=20, suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture]
)
@hypothesis.given(
    pdu=st.one_of(
        st.binary(max_size=12), st.binary(max_size=10).map(lambda data: b"\x03" + data)
    )
)
def test_whoever_answers_can_say_registers_or_cost_the_connection(serve, pdu):
    """Bytes that are no answer are silence, a late answer, a refusal or a lost line: never anything
    that ends the poller."""
    try:
        block = ask(serve(lambda _: pdu), [BLOCK], timeout_s=0.05)
    except DeviceError:
        return
    assert pdu[:2] == b"\x03\x06"
    assert block.data == (pdu[2:8],)


@pytest.mark.parametrize(
    "value",
    [0xABCD, 0xABCD - 0x10000, 0x1ABCD],
    ids=["uint16", "int16 after its wrap", "uint32 beyond 16 bits"],
)
def test_the_handshake_writes_one_register_with_function_10h(serve, value):
    """Controls such as FANUC serve 03h, 10h and 17h only (B-64414EN). A register holds 16 bits,
    whatever the stop count came in."""
    asked = []

    def answer(pdu):
        asked.append(pdu)
        return pdu[:5]

    async def work(link):
        await link.write_word("holding", 100, value)

    ask(serve(answer), [BLOCK], work)
    assert asked == [b"\x10\x00\x64\x00\x01\x02\xab\xcd"]


class Deaf:
    """A link whose device says nothing as long as it is deaf."""

    def __init__(self):
        self.deaf, self.lateness, self.refusals = False, Lateness(numbered=True), {}

    async def read(self):
        await asyncio.sleep(0)
        if self.deaf:
            raise SilentDeviceError("machine", expected="an answer", found="silence")
        return ModbusBlock(now_ns(), now_ns(), (BLOCK,), (bytes(6),))

    def close(self):
        pass


def poll_for(server, during, *, period_s=0.02, timeout_s=60.0):
    """Keep the machine while ``during`` runs; return blocks, changes of state, and the log."""
    blocks, states = [], []
    machine = MachinePoller(settings(server, timeout_s), [BLOCK], period_s, blocks.append)

    async def run():
        keeper = Reconnector(
            "machine", machine.session, lambda state, *_: states.append(state)
        )
        task = asyncio.create_task(keeper.run())
        await asyncio.to_thread(during, machine, blocks, states)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    with capture_logs() as logs:
        asyncio.run(run())
    return blocks, states, logs


def until_more(count):
    """Return what waits until so many blocks more have come."""

    def during(_machine, blocks, _states):
        polled = len(blocks)
        wait_until(lambda: len(blocks) >= polled + count)

    return during


def test_polls_keep_their_beat_and_are_never_queued(serve):
    def answer(pdu):
        time.sleep(0.03)
        return b"\x03" + registers(1, 2, 3)

    blocks, states, _ = poll_for(serve(answer), until_more(15))
    assert states == ["connecting", "connected"]
    steps = [round((b.send_ns - a.send_ns) / 20e6) for a, b in pairwise(blocks)]
    assert (
        min(steps) >= 2
        # 30 ms an answer: never more often than every second beat of 20 ms, on a busy computer less
        # often
    )
    assert all(a.recv_ns <= b.send_ns for a, b in pairwise(blocks))


def test_after_three_silent_polls_the_connection_is_made_anew(serve, monkeypatch):
    link, opened = Deaf(), []

    async def open_link(*_):
        opened.append(link)
        return link

    monkeypatch.setattr(poller, "open_machine", open_link)

    def during(machine, blocks, states):
        wait_until(lambda: len(blocks) > 3)
        link.deaf = True
        wait_until(lambda: len(opened) == 2)
        link.deaf = False
        until_more(1)(machine, blocks, states)

    _, states, logs = poll_for(serve(lambda pdu: None), during)
    assert states[:4] == ["connecting", "connected", "silent", "lost"]
    assert states[-1] == "connected"
    assert [entry["log_level"] for entry in logs].count("warning") == 1


def test_a_server_that_comes_back_is_polled_again(serve):
    """How soon is what the reconnector waits between two attempts (test_reconnect)."""
    server = serve(lambda pdu: b"\x03" + registers(1, 2, 3))

    def during(machine, blocks, states):
        wait_until(lambda: len(blocks) > 3)
        server.stop()
        wait_until(lambda: states[-1] == "lost")
        heard = len(blocks)
        server.start()
        wait_until(lambda: len(blocks) > heard)

    # a connection that ends while an answer is due is only found lost when the answer has had its
    # time
    _, states, _ = poll_for(server, during, timeout_s=5.0)
    assert states == ["connecting", "connected", "lost", "connected"]


def test_a_device_that_refuses_everything_is_asked_again(serve, monkeypatch):
    monkeypatch.setattr(poller, "REFUSED_WAIT_S", 0.05)
    starting = iter([True] * 3)
    server = serve(
        lambda pdu: b"\x83\x06" if next(starting, False) else b"\x03" + registers(1, 2, 3)
    )
    blocks, states, _ = poll_for(server, until_more(1))
    assert states == ["connecting", "silent", "connected"]
    assert blocks


def test_a_handshake_waits_for_the_connection_and_a_refused_one_does_not_stop_the_polls(
    serve,
):
    written = []

    def answer(pdu):
        if pdu[0] == 0x10:
            written.append(pdu[-2:])
            return b"\x90\x02" if pdu[-2:] == b"\x00\x02" else pdu[:5]
        return b"\x03" + registers(1, 2, 3)

    def during(machine, blocks, states):
        machine.write_soon("holding", 100, 1)
        wait_until(lambda: len(written) == 1)
        machine.write_soon("holding", 100, 2)
        wait_until(lambda: len(written) == 2)
        until_more(4)(machine, blocks, states)

    _, states, logs = poll_for(serve(answer), during)
    assert written == [b"\x00\x01", b"\x00\x02"]
    assert states == ["connecting", "connected"]
    assert "write-refused" in [entry["event"] for entry in logs]


def test_a_handshake_does_not_wait_for_the_next_poll(serve):
    """The machine stands idle until it is written; polls an hour apart do not hold it up, nor come
    sooner for it."""
    written, blocks = threading.Event(), []

    def answer(pdu):
        return pdu[:5] if pdu[0] == 0x10 else b"\x03" + registers(1, 2, 3)

    def on_written(refused):
        assert not refused
        written.set()

    machine = MachinePoller(
        settings(serve(answer)), [BLOCK], 3600.0, blocks.append, on_written
    )

    async def run():
        task = asyncio.create_task(
            Reconnector("machine", machine.session, lambda *_: None).run()
        )
        await asyncio.to_thread(wait_until, lambda: bool(blocks))
        machine.write_soon("holding", 100, 7)
        assert await asyncio.to_thread(written.wait, 60.0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    assert len(blocks) == 1


def test_an_order_to_end_is_heeded_even_if_the_client_forgets_it(serve, monkeypatch):
    """`asyncio.wait_for` of Python 3.11 returns the answer that came together with the
    cancellation, which is then lost."""
    whole = ModbusLink.read
    answered = []

    async def read(link):
        block = await whole(link)
        answered.append(block)
        with suppress(asyncio.CancelledError):
            await asyncio.sleep(3600.0)
        return block

    monkeypatch.setattr(ModbusLink, "read", read)
    machine = MachinePoller(
        settings(serve(lambda pdu: b"\x03" + registers(1, 2, 3))),
        [BLOCK],
        0.02,
        lambda block: None,
    )

    async def run():
        task = asyncio.create_task(
            Reconnector("machine", machine.session, lambda *_: None).run()
        )
        await asyncio.to_thread(wait_until, lambda: bool(answered))
        task.cancel()
        done, _ = await asyncio.wait({task}, timeout=60.0)
        assert done == {task}

    asyncio.run(run())


def test_a_name_server_that_never_answers_is_given_up(monkeypatch):
    """The library gave up already; who asks the network once more, for the reason, does not wait
    for ever either."""
    answered = threading.Event()
    monkeypatch.setattr(
        "stepdiag.daq.links.controls.modbus.socket.create_connection",
        lambda *_: answered.wait(60.0),
    )
    place = TcpSettings(host="no-such-control.invalid", port=1, connect_s=0.1)
    try:
        with pytest.raises(LostConnectionError, match=r"found silence for 0\.1 s"):
            asyncio.run(open_link(place, [BLOCK]))
    finally:
        answered.set()
