"""The stale answer of Modbus RTU over a real pty slave, and links that are pulled out and put
back."""

import asyncio
import itertools
import struct
from contextlib import suppress

import pytest
from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusIOException

from stepdiag.daq.links.controls.modbus import RtuSettings, answer_within, open_link
from stepdiag.daq.links.controls.modbus_errors import SilentDeviceError, StaleAnswerError
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.serial import SerialStream
from stepdiag.daq.links.reconnect import Reconnector
from stepdiag.daq.records.events import ReadRange
from stepdiag.daq.timing.host_clock import now_ns
from testkit.running.slaves import Pty, rtu_slave, symlink, wait_until

pytestmark = pytest.mark.system

BLOCK = ReadRange("holding", 0, 10)
SHORT_S, LONG_S = 0.2, 60.0
"""What is meant to be given up, and what is meant to come."""
BEAT_S = 0.05


@pytest.fixture
def pty():
    line = Pty()
    yield line
    line.close()


class Machine:
    """Registers that hold the millisecond at which the slave looked at them, so that an old answer
    shows."""

    def __init__(self, held=()):
        """``held``: numbers of the requests, from 0, whose answer is sent only when the next
        request has come."""
        self.began_ns = now_ns()
        self._numbers, self._held, self._waiting = itertools.count(), held, []

    def look(self, pdu):
        _, _, count = struct.unpack(">BHH", pdu)
        now = (now_ns() - self.began_ns) // 1_000_000
        return struct.pack(f">BB{count}H", 3, 2 * count, *[now] * count)

    def answer(self, pdu):
        answers, self._waiting = [*self._waiting, self.look(pdu)], []
        if next(self._numbers) in self._held:
            self._waiting = [answers.pop()]
        return answers

    def age_ms(self, block):
        """Milliseconds by which the registers are older than the request; negative where they are
        not."""
        looked = struct.unpack(">10H", block.data[0])[0]
        return (block.send_ns - self.began_ns) / 1e6 - looked


def settings(pty):
    return RtuSettings(port=pty.name, baud=115200, parity="N", timeout_s=LONG_S)


async def given_up(link):
    """Read once, with little patience; the answer is not there in time."""
    answer_within(link._client, SHORT_S)
    with pytest.raises(SilentDeviceError, match=r"baud rate, parity, wiring and unit id"):
        await link.read()
    answer_within(link._client, LONG_S)


def test_a_bare_client_hands_out_old_answers_for_ever_after_one_that_came_late(pty):
    """The hazard itself, so that the next test is known to be able to fail: instruments 4.3. The
    slave stays one answer behind."""
    machine, ages = Machine(held=range(1, 100)), []

    async def run():
        client = AsyncModbusSerialClient(
            pty.name, baudrate=115200, timeout=LONG_S, retries=0, reconnect_delay=0
        )
        await client.connect()
        await client.read_holding_registers(0, count=10)
        answer_within(client, SHORT_S)
        with pytest.raises(ModbusIOException):
            await client.read_holding_registers(0, count=10)
        answer_within(client, LONG_S)
        for _ in range(5):
            await asyncio.sleep(BEAT_S)
            asked_ms = (now_ns() - machine.began_ns) / 1e6
            answer = await client.read_holding_registers(0, count=10)
            ages.append(asked_ms - answer.registers[0])
        client.close()

    with rtu_slave(pty, machine.answer):
        asyncio.run(run())
    assert min(ages) > 0.8 * BEAT_S * 1000


def test_an_answer_that_came_late_is_never_taken_for_the_next(pty):
    """It comes when the next request has been sent: every block was looked up after it was asked
    for."""
    machine, late_s = Machine(held=[1]), []

    async def run():
        link = await open_link(settings(pty), [BLOCK])
        await given_up(link)
        blocks = []
        for _ in range(5):
            await asyncio.sleep(BEAT_S)
            with suppress(StaleAnswerError):
                blocks.append(await link.read())
        link.close()
        late_s.append(link.lateness.after_s)
        return blocks

    with rtu_slave(pty, machine.answer):
        blocks = asyncio.run(run())
    assert len(blocks) >= 4
    assert max(machine.age_ms(block) for block in blocks) <= 1
    assert late_s[0] > SHORT_S, "how late it was is known, for plc.timeout_s"


def test_an_answer_later_than_any_wait_is_known_by_its_length(pty, monkeypatch):
    """Waiting alone does not help against a slave that was away for longer."""
    monkeypatch.setattr("stepdiag.daq.links.controls.modbus.RTU_WORST_ANSWER_S", 0.0)
    machine = Machine(held=[1])

    async def run():
        link = await open_link(settings(pty), [BLOCK])
        await given_up(link)
        blocks = []
        for _ in range(12):
            with suppress(ConnectionError):
                blocks.append(await link.read())
        link.close()
        return blocks

    with rtu_slave(pty, machine.answer):
        blocks = asyncio.run(run())
    assert len(blocks) > 3
    assert max(machine.age_ms(block) for block in blocks) <= 1


def test_a_cancelled_poll_leaves_no_answer_behind(pty):
    machine = Machine(held=[2])

    async def run():
        link = await open_link(settings(pty), [BLOCK])
        await link.read()
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(link.read(), SHORT_S)
        block = await link.read()
        link.close()
        return block

    with rtu_slave(pty, machine.answer):
        assert machine.age_ms(asyncio.run(run())) <= 1


def test_a_line_pulled_out_is_read_again_when_it_returns(tmp_path):
    link, lines = tmp_path / "laser", [Pty(), Pty()]
    symlink(link, lines[0].name)
    heard, states = [], []

    def use():
        wait_until(lambda: "connected" in states)
        lines[0].write(b"before")
        wait_until(lambda: b"".join(heard) == b"before")
        link.unlink()
        lines[0].close()
        wait_until(lambda: states[-1] == "lost")
        symlink(link, lines[1].name)
        wait_until(lambda: states[-1] == "connected")
        lines[1].write(b"after")
        wait_until(lambda: b"".join(heard) == b"beforeafter")

    async def run():
        stream = SerialStream(
            SerialSettings(port=str(link)), lambda data, _: heard.append(data)
        )
        task = asyncio.create_task(
            Reconnector("laser", stream.session, lambda state, *_: states.append(state)).run()
        )
        await asyncio.to_thread(use)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    lines[1].close()
    assert states == ["connecting", "connected", "lost", "connected"]
