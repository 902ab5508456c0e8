"""Serial links over real ptys: nothing lost, stamped where it is read, no thread that ends
unseen."""

import asyncio
import struct
import threading
import time
from dataclasses import replace

import pytest

from stepdiag.base.errors import DeviceError
from stepdiag.daq.links.ports import port_thread, serial, tty
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.port import OpenPort
from stepdiag.daq.links.ports.port_thread import PortThread
from stepdiag.daq.links.ports.serial import PolledSerial, SerialStream
from stepdiag.daq.links.reconnect import Reconnector
from stepdiag.daq.timing.host_clock import now_ns
from testkit.running.slaves import Pty, running, wait_until


@pytest.fixture
def pty():
    line = Pty()
    yield line
    line.close()


def settings(pty):
    return SerialSettings(port=pty.name)


class States(list):
    """What a session reports, changes only."""

    def __call__(self, state, detail, lost=()):
        if not self or self[-1] != state:
            self.append(state)


async def while_running(session, work, states):
    """Run ``work`` in a thread while the session runs, then cancel the session as the daemon
    does."""
    task = asyncio.create_task(session(states))
    try:
        await asyncio.to_thread(work)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def serial_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("serial ")]


def test_every_byte_arrives_in_order_with_a_stamp_of_the_moment(pty):
    chunks, states = [], States()
    sent = [bytes([number]) * 100 for number in range(20)]

    def work():
        wait_until(lambda: states == ["connected"])
        for block in sent:
            before_ns = now_ns()
            pty.write(block)
            wait_until(
                lambda whole=100 * (block[0] + 1): (
                    sum(len(data) for data, _ in chunks) == whole
                )
            )
            assert before_ns - 1000 <= chunks[-1][1] <= now_ns()

    asyncio.run(
        while_running(
            SerialStream(settings(pty), lambda *chunk: chunks.append(chunk)).session,
            work,
            states,
        )
    )
    assert b"".join(data for data, _ in chunks) == b"".join(sent)
    assert all(arrival_ns % 1000 == 0 for _, arrival_ns in chunks)
    assert not serial_threads()


def assert_gathered(handed_ns):
    """Two chunks are about as far apart as what is gathered into one, however slowly a busy
    computer lets the bytes come."""
    assert len(handed_ns) <= 2 + (handed_ns[-1] - handed_ns[0]) / 1e9 / (serial.GATHER_S / 2)


def test_a_chunk_is_what_came_within_two_hundredths_of_a_second_stamped_by_its_last_line(pty):
    """500 lines a second, each holding the moment it was written: few chunks, each stamped between
    its last line and its handing over."""
    chunks, states, handed_ns = [], States(), []

    def take(data, arrival_ns):
        chunks.append((data, arrival_ns))
        handed_ns.append(now_ns())

    def work():
        wait_until(lambda: states == ["connected"])
        for _ in range(300):
            pty.write(b"%d\n" % now_ns())
            time.sleep(0.002)
        wait_until(lambda: sum(data.count(b"\n") for data, _ in chunks) == 300)

    asyncio.run(while_running(SerialStream(settings(pty), take).session, work, states))
    assert_gathered(handed_ns)
    for (data, stamp), handed in zip(chunks, handed_ns, strict=True):
        assert int(data.splitlines()[-1]) - 1000 <= stamp <= handed


def test_a_busy_line_is_read_whole_and_its_silence_and_its_end_are_seen(pty):
    """A megabyte at full speed, a silence, a single line again after it, and the cable."""
    chunks, states, handed_ns = [], States(), []
    block = bytes(range(256)) * 16

    def heard():
        return sum(len(data) for data, _ in chunks)

    def take(*chunk):
        chunks.append(chunk)
        handed_ns.append(now_ns())

    async def serve():
        task = asyncio.create_task(SerialStream(settings(pty), take).session(states))
        await asyncio.to_thread(work)
        pty.close()
        await task

    def work():
        wait_until(lambda: states == ["connected"])
        for _ in range(256):
            pty.write(block)
        wait_until(lambda: heard() == 256 * len(block))
        time.sleep(0.3)
        before_ns = now_ns()
        pty.write(b"last")
        wait_until(lambda: heard() == 256 * len(block) + 4)
        assert before_ns - 1000 <= chunks[-1][1] <= now_ns()

    with pytest.raises(DeviceError, match="the port is gone"):
        asyncio.run(serve())
    assert b"".join(data for data, _ in chunks) == block * 256 + b"last"
    assert len(chunks) < 200 or len(handed_ns) <= (handed_ns[-1] - handed_ns[0]) / 1e9 / (
        serial.GATHER_S / 2
    )
    assert not serial_threads()


def test_who_is_in_a_hurry_gets_what_is_there(pty, monkeypatch):
    """Between two chunks the reader sleeps, here for an hour; it hands over at once what somebody
    waits for."""
    monkeypatch.setattr(serial, "GATHER_S", 3600.0)
    chunks, states = [], States()
    stream = SerialStream(settings(pty), lambda *chunk: chunks.append(chunk))

    def heard():
        return b"".join(data for data, _ in chunks)

    def work():
        wait_until(lambda: states == ["connected"])
        while not chunks:  # two reads in one chunk, then a silence: from then on it sleeps
            pty.write(b"a")
            time.sleep(0.001)
            pty.write(b"a")
            time.sleep(0.05)
        for _ in range(3):
            whole = len(heard()) + 50
            pty.write(b"b" * 50)
            wait_until(lambda whole=whole: stream.hurry() or len(heard()) >= whole)

    asyncio.run(while_running(stream.session, work, states))
    assert heard().endswith(b"b" * 150)


def test_a_busy_line_is_handed_over_too_when_somebody_is_in_a_hurry(pty, monkeypatch):
    """The line is read without listening to the bell, and here a chunk lasts for an hour or until a
    silence, which does not come."""
    monkeypatch.setattr(serial, "GATHER_S", 3600.0)
    monkeypatch.setattr(serial, "LARGEST_CHUNK", 1 << 40)
    chunks, states, block = [], States(), bytes(4096)
    stream = SerialStream(settings(pty), lambda *chunk: chunks.append(chunk))

    def feed(ended):
        while not ended.is_set():
            pty.write(block)

    def work():
        wait_until(lambda: states == ["connected"])
        for _ in range(64):
            pty.write(block)
        wait_until(lambda: len(chunks) > 0)
        with running(feed):
            for _ in range(3):
                before = len(chunks)
                time.sleep(0.1)
                stream.hurry()
                wait_until(lambda before=before: len(chunks) > before)

    asyncio.run(while_running(stream.session, work, states))


def test_cancelling_ends_the_thread_by_itself(pty, monkeypatch):
    """Not by giving it up as one that hangs: here that would take an hour."""
    monkeypatch.setattr(port_thread, "_END_TIMEOUT_S", 3600.0)
    states = States()
    asyncio.run(
        while_running(
            SerialStream(settings(pty), lambda *_: None).session,
            lambda: wait_until(lambda: bool(states)),
            states,
        )
    )
    assert not serial_threads()


def test_a_port_that_is_not_there_is_refused_by_name(tmp_path):
    stream = SerialStream(SerialSettings(port=str(tmp_path / "ttyNone")), lambda *_: None)
    with pytest.raises(
        DeviceError,
        match=r"ttyNone: expected a port that opens, found No such file.*plugged in",
    ):
        asyncio.run(stream.session(States()))


def test_an_adapter_that_came_back_under_another_number_is_offered(tmp_path, monkeypatch):
    monkeypatch.setattr(tty, "present_ports", lambda: {"/dev/ttyUSB1": "FT232R"})
    stream = SerialStream(SerialSettings(port=str(tmp_path / "ttyUSB0")), lambda *_: None)
    with pytest.raises(
        DeviceError,
        match=r"ttyUSB0: .*This computer has the ports /dev/ttyUSB1.*no pass is lost",
    ):
        asyncio.run(stream.session(States()))


def test_a_port_in_use_by_another_is_refused(pty):
    other = OpenPort(settings(pty))
    with pytest.raises(DeviceError, match="another program has the port open"):
        asyncio.run(SerialStream(settings(pty), lambda *_: None).session(States()))
    other.close()


def test_a_port_that_does_not_take_the_settings_is_not_blamed_on_the_cable(pty):
    """A pty opens with a parity, and refuses it when it is set up once more."""
    stream = SerialStream(replace(settings(pty), parity="E"), lambda *_: None)
    with pytest.raises(
        DeviceError,
        match=r"expected a port that accepts these settings, found Invalid argument.*parity",
    ):
        asyncio.run(stream.session(States()))


def test_a_cable_pulled_out_ends_the_session(pty):
    async def pulled():
        states = States()
        task = asyncio.create_task(
            SerialStream(settings(pty), lambda *_: None).session(states)
        )
        await asyncio.to_thread(wait_until, lambda: bool(states))
        pty.close()
        await task

    with pytest.raises(DeviceError, match="the port is gone"):
        asyncio.run(pulled())
    assert not serial_threads()


def test_what_came_just_before_the_cable_was_pulled_is_handed_over():
    """Bytes that were being gathered into a chunk are not thrown away with the line."""

    class Failing:
        wanted = True

        def __init__(self):
            self.reads = iter([b"one", b"two"])

        def pause(self, _seconds):
            pass

        def read(self, _timeout_s):
            return self.read_on()

        def read_on(self):
            if data := next(self.reads, b""):
                return data
            raise DeviceError("serial port x", expected="a line", found="it is gone")

    chunks = []
    stream = SerialStream(SerialSettings(port="x"), lambda data, _: chunks.append(data))
    with pytest.raises(DeviceError, match="it is gone"):
        stream._read(Failing())
    assert b"".join(chunks) == b"onetwo"


def test_a_fault_in_the_reading_thread_is_seen_by_its_supervisor(pty):
    def broken(data, arrival_ns):
        raise ZeroDivisionError

    async def serve():
        states = States()
        task = asyncio.create_task(SerialStream(settings(pty), broken).session(states))
        await asyncio.to_thread(wait_until, lambda: states == ["connected"])
        pty.write(b"x")
        await task

    with pytest.raises(ZeroDivisionError):
        asyncio.run(serve())
    assert not serial_threads()


def test_a_silent_line_is_said_and_so_is_its_return(pty, monkeypatch):
    monkeypatch.setattr(port_thread, "SILENT_AFTER_S", 0.2)
    monkeypatch.setattr(port_thread, "_WATCH_S", 0.02)
    states = States()

    def work():
        wait_until(lambda: states == ["connected", "silent"])
        pty.write(b"x")
        wait_until(lambda: states[:3] == ["connected", "silent", "connected"])

    asyncio.run(
        while_running(SerialStream(settings(pty), lambda *_: None).session, work, states)
    )


def test_a_pty_has_no_low_latency_mode_and_that_is_borne(pty):
    port = OpenPort(settings(pty))
    assert port.low_latency is False
    port.close()


class Display:
    """A port with a polled display behind it, whose time passes only where a test says so."""

    low_latency = True

    def __init__(self, monkeypatch, answer):
        self.wanted, self.now_ns, self._answer = True, 1_000_000_000, list(answer)
        monkeypatch.setattr(serial, "stamp_ns", lambda: self.now_ns)

    def write(self, _request):
        self.now_ns += 1_000_000

    def read(self, _timeout_s):
        """Return the next piece of the answer, 60 ms after whatever came before it."""
        self.now_ns += 60_000_000
        return self._answer.pop(0) if self._answer else b""

    def pause(self, _seconds):
        self.wanted = False


def test_an_answer_is_stamped_with_the_middle_between_request_and_answer(monkeypatch):
    """A display has no time of its own: the value was latched between the request and the first
    byte of the answer."""
    chunks = []
    polled = PolledSerial(
        SerialSettings(port="x"),
        lambda *chunk: chunks.append(chunk),
        request=b"\x1bA0200\r",
        interval_s=0.1,
    )
    polled._poll(Display(monkeypatch, [b"\x02+00000", b"1234\r\n"]))
    assert chunks == [(b"\x02+00000", 1_031_000_000), (b"1234\r\n", 1_031_000_000)]


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next(monkeypatch):
    """Nothing within the time allowed, then the late answer, then silence: only then does the next
    request go out."""
    chunks = []
    display = Display(monkeypatch, [b"", b"0001\n", b"", b"0002\n", b""])
    display.pause = lambda _seconds: setattr(display, "wanted", bool(display._answer))
    polled = PolledSerial(
        SerialSettings(port="x"),
        lambda *chunk: chunks.append(chunk),
        request=b"?",
        interval_s=0.03,
    )
    polled._poll(display)
    assert [data for data, _ in chunks] == [b"0002\n"]


def test_work_that_returns_ends_the_session_too(pty):
    async def serve():
        await PortThread(settings(pty), lambda port: None).serve(States())

    asyncio.run(serve())
    assert not serial_threads()


@pytest.fixture
def counts(monkeypatch):
    """A driver that counts as a real one does (a pty has no such counters): frame 6, overrun 7,
    parity 8, break 9, buffer 10."""
    told, ioctl = [0] * 20, tty.fcntl.ioctl

    def asked(line, request, *more):
        return (
            struct.pack("20i", *told)
            if request == tty.TIOCGICOUNT
            else ioctl(line, request, *more)
        )

    monkeypatch.setattr(tty.fcntl, "ioctl", asked)
    return told


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (7, "the port's own buffer overflowed 3 times"),
        (10, "the system's buffer overflowed 3 times"),
        (6, "framing was wrong 3 times"),
        (8, "parity was wrong 3 times"),
        (9, "the line was interrupted 3 times"),
    ],
)
def test_bytes_lost_in_the_port_are_said_once_with_where_it_was(pty, counts, place, words):
    """What was counted before the port was opened is nobody's loss."""
    counts[place] = 40
    states, heard = [], []

    def work():
        wait_until(lambda: states == ["connected"])
        counts[place] += 3
        wait_until(lambda: len(heard) >= 3)
        pty.write(b"still there\n")
        wait_until(lambda: chunks)

    def on_state(state, detail, lost=()):
        heard.append((state, lost))
        states[:] = [each for each, _ in heard if each != "connecting"]

    chunks = []
    stream = SerialStream(settings(pty), lambda data, _: chunks.append(data))

    async def run():
        link = asyncio.create_task(Reconnector("laser", stream.session, on_state).run())
        await asyncio.to_thread(work)
        link.cancel()
        await asyncio.gather(link, return_exceptions=True)

    asyncio.run(run())
    assert [state for state, _ in heard[:3]] == ["connecting", "connected", "connected"]
    assert heard[1][1] == ()
    assert str(heard[2][1][0]).startswith(words)
    assert len([lost for _, lost in heard if lost]) == 1


def test_a_line_that_does_not_count_says_nothing_of_losses(pty):
    port = OpenPort(settings(pty))
    assert port.lost() == {}
    port.close()
    assert port.lost() == {}


def test_nobody_waits_for_a_port_that_takes_long_to_close(pty, monkeypatch):
    """A line that holds bytes nobody takes keeps a close waiting for half a minute; the event loop
    asks for losses meanwhile."""
    port, closing, go_on = OpenPort(settings(pty)), threading.Event(), threading.Event()
    close = port._device.close

    def slowly():
        closing.set()
        go_on.wait(60)
        close()

    monkeypatch.setattr(port._device, "close", slowly)
    closer = threading.Thread(target=port.close)
    closer.start()
    closing.wait(60)
    asker = threading.Thread(target=lambda: (port.lost(), port.release()), daemon=True)
    asker.start()
    asker.join(10)
    waited = asker.is_alive()
    go_on.set()
    closer.join()
    assert not waited
