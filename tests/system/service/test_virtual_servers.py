"""The virtual bench over real sockets, ptys and processes, seen by ordinary clients."""

import json
import struct
import subprocess
import sys
import threading
import time
from contextlib import closing

import pytest
import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from stepdiag.virtual.base.faults import Fault
from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.config import load_config

pytestmark = pytest.mark.system

QUICK = """
time_scale = 20.0
[volume]
increments = 1
[program]
setups = ["ppp"]
feed_mm_min = 10000.0
dwell_s = 4.0
pause_s = 2.0
"""
PATIENT = QUICK.replace("pause_s", "patient = true\npause_s")
PACED = QUICK.replace("pause_s", "handshake = true\npause_s")


def until(what, timeout_s=60.0):
    """Wait for something to become true and return it."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if seen := what():
            return seen
        time.sleep(0.01)
    raise AssertionError("nothing happened in time")


@pytest.fixture
def bench_of(tmp_path):
    opened = []

    def build(text=QUICK, tell=None):
        bench = VirtualBench(load_config(text), tmp_path, tell=tell)
        bench.start()
        opened.append(bench)
        return bench

    yield build
    for bench in opened:
        bench.close()


@pytest.fixture
def master_of():
    opened = []

    def connect(bench, **options):
        addresses = bench.addresses
        if "plc_port" in addresses:
            client = ModbusTcpClient(
                "127.0.0.1", port=addresses["plc_port"], timeout=60.0, **options
            )
        else:
            client = ModbusSerialClient(
                addresses["plc_link"], baudrate=115200, timeout=60.0, **options
            )
        assert client.connect()
        opened.append(client)
        return client

    yield connect
    for client in opened:
        client.close()


def block(client):
    answer = client.read_holding_registers(0, count=14, device_id=1)
    assert not answer.isError()
    return answer.registers


def standing_at(client, count):
    registers = block(client)
    return registers[1] == count and registers[2] & 1


def positions(registers):
    return [
        value * 1e-4 for value in struct.unpack(">3i", struct.pack(">6H", *registers[4:10]))
    ]


@pytest.mark.parametrize("transport", ["tcp", "rtu"])
def test_a_master_follows_the_program_to_its_end(bench_of, master_of, transport):
    finished = threading.Event()

    def tell(event):
        if event["event"] == "finished":
            finished.set()

    bench = bench_of(PATIENT + f'[plc]\ntransport = "{transport}"\n', tell)
    client = master_of(bench)
    stops = {}
    while not finished.wait(0.02):
        registers = block(client)
        if registers[2] & 1:
            stops[registers[1]] = (registers[3], positions(registers))
    corners = [[0, 0, 0], [500, 0, 0], [500, 400, 0], [500, 400, 300]]
    assert [stops[count] for count in sorted(stops)] == [
        (1, pytest.approx(corner)) for corner in (*corners, *corners[::-1])
    ]


def lines_of(port, wanted=5):
    """Return ``wanted`` whole lines."""
    received = b""

    def enough():
        nonlocal received
        received += port.read(4096)
        return received.count(b"\n") > wanted

    until(enough)
    return received.split(b"\r\n")[1:-1]


def test_the_laser_counts_the_travel_between_two_stops(bench_of, master_of):
    bench = bench_of(
        PACED + "[machine]\nscale_um_m = 0.0\npositioning_um = 0.0\nstraightness_um = "
        "0.0\nsquareness_urad = 0.0\n"
    )
    client = master_of(bench)
    readings = []
    with serial.Serial(bench.addresses["laser_link"], 115200, timeout=0.0) as port:
        for count in range(1, 5):
            until(lambda wanted=count: standing_at(client, wanted))
            time.sleep(0.05)
            port.reset_input_buffer()
            words = [int(word) for word in lines_of(port)[-1].split()]
            client.write_register(100, count, device_id=1)
            readings.append((words[2] - words[4] / 65536) * 632.991e-6 / 2)
    travelled = (500.0**2 + 400.0**2 + 300.0**2) ** 0.5
    assert readings[3] - readings[0] == pytest.approx(travelled * 1.0002714, abs=0.002)


def test_a_reader_who_comes_late_sees_the_present(bench_of):
    bench = bench_of(QUICK.replace("pause_s = 2.0", "pause_s = 2000.0"))
    time.sleep(1.5)
    with serial.Serial(bench.addresses["laser_link"], 115200, timeout=0.0) as port:
        sequence = [int(line.split()[5]) for line in lines_of(port, 600)]
    assert sequence[0] > 700


def test_a_display_answers_on_its_line(bench_of):
    bench = bench_of(QUICK + '[laser]\nformat = "nd"\n')
    with serial.Serial(bench.addresses["laser_link"], 9600, timeout=60.0) as port:
        port.write(b"\x1bA0000\r")
        assert port.readline() == b"\x02ND-287\r\n"

        def value():
            port.reset_input_buffer()
            port.write(b"\x1bA0200\r")
            answer = port.read_until(b"\n") if port.read(1) == b"\x02" else b""
            return answer.startswith((b"+", b"-")) and answer

        assert len(until(value)) == 12


def test_an_unplugged_laser_comes_back_under_its_name_and_counts_from_zero(bench_of):
    bench = bench_of(QUICK.replace("pause_s = 2.0", "pause_s = 2000.0"))
    link = bench.addresses["laser_link"]
    with serial.Serial(link, 115200, timeout=0.0) as port:
        lines_of(port, 300)
        injected_s = time.monotonic()
        bench.inject(Fault(kind="laser-unplug", duration_s=0.4))

        def hung_up():
            try:
                return port.read(4096) is None
            except serial.SerialException:
                return True

        until(hung_up)

    def reopened():
        try:
            return serial.Serial(link, 115200, timeout=0.0)
        except serial.SerialException:
            return None

    with until(reopened) as port:
        number, since_s = int(lines_of(port)[0].split()[5]), time.monotonic() - injected_s
    assert number < 1000 * since_s, "without a return to zero 300 more"


def test_garbage_and_a_wrong_baud_rate_reach_the_reader(bench_of):
    bench = bench_of(QUICK.replace("pause_s = 2.0", "pause_s = 2000.0"))
    with serial.Serial(bench.addresses["laser_link"], 115200, timeout=0.0) as port:
        for kind in ("laser-garbage", "laser-baud"):
            bench.inject(Fault(kind=kind, duration_s=0.2, value=64))
            until(lambda: any(byte > 127 for byte in port.read(4096)))

        def clean():
            port.reset_input_buffer()
            return all(len(line.split()) == 8 for line in lines_of(port, 30))

        until(clean)


def test_a_rebooting_plc_hangs_up_and_counts_from_zero(bench_of, master_of):
    """The machine stands at its second stop all the time."""
    bench = bench_of(PACED)
    client = master_of(bench)
    client.write_register(100, 1, device_id=1)
    until(lambda: standing_at(client, 2))
    bench.inject(Fault(kind="plc-reboot", duration_s=2.0))

    def answers():
        with closing(
            ModbusTcpClient("127.0.0.1", port=bench.addresses["plc_port"], timeout=60.0)
        ) as again:
            return again.connect()

    until(lambda: not answers())
    until(answers)
    assert block(master_of(bench))[1] <= 1


def test_a_silent_a_refusing_and_a_late_plc(bench_of, master_of):
    bench = bench_of()
    client = master_of(bench, retries=0)
    assert client.read_holding_registers(0, count=1, device_id=9).exception_code == 11
    assert client.read_holding_registers(50, count=1, device_id=1).exception_code == 2
    bench.inject(Fault(kind="plc-late", duration_s=60.0, value=0.3))
    begin = time.monotonic()
    block(client)
    assert time.monotonic() - begin > 0.28
    bench.inject(Fault(kind="plc-exception", duration_s=60.0, value=6))
    assert client.read_holding_registers(0, count=14, device_id=1).exception_code == 6


def test_the_machine_waits_for_the_captured_stop(bench_of, master_of):
    bench = bench_of(QUICK.replace("dwell_s = 4.0", "dwell_s = 1.0\nhandshake = true"))
    client = master_of(bench)
    until(lambda: block(client)[1] == 1)
    time.sleep(0.5)
    assert block(client)[1] == 1
    client.write_register(100, 1, device_id=1)
    until(lambda: block(client)[1] == 2)


def test_a_hundred_thousand_lines_arrive_without_a_gap(bench_of):
    """The load of issue 7, made in one second: a lossless line waits for a reader who is held up.
    How fast that is `make bench` says."""
    bench = bench_of(
        QUICK.replace("pause_s = 2.0", "pause_s = 2000.0")
        + "[laser]\nrate_hz = 100000.0\nlossless = true\n"
    )
    received = b""
    with serial.Serial(bench.addresses["laser_link"], 115200, timeout=0.05) as port:
        for held_up_s, lines in ((1.0, 30_000), (0.0, 100_000)):
            while received.count(b"\n") <= lines:
                received += port.read(65536)
            time.sleep(held_up_s)
    sequence = [int(line.split()[5]) for line in received.split(b"\r\n")[1:-1]]
    assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))


@pytest.fixture
def process(tmp_path):
    file = tmp_path / "bench.toml"
    file.write_text(QUICK + 'start = "command"\n', encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "stepdiag.virtual",
        "--config",
        str(file),
        "--directory",
        str(tmp_path / "run"),
    ]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as running:
        yield running
        running.terminate()


def test_the_process_tells_where_it_is_and_obeys(process):
    def said():
        return json.loads(process.stdout.readline())

    def tell(text):
        process.stdin.write(text + "\n")
        process.stdin.flush()

    ready = said()
    assert ready["event"] == "ready"
    assert {"plc_host", "plc_port", "laser_link"} <= ready.keys()
    assert said()["event"] == "waiting"
    tell('fault {"kind": "nonsense"}')
    assert said()["event"] == "refused"
    tell("start")
    assert said() == {"event": "setup", "setup": "ppp"}
    assert said()["event"] == "finished"
    tell("quit")
    assert process.wait(60.0) == 0


def test_a_wrong_configuration_is_refused_by_its_field(tmp_path):
    file = tmp_path / "bench.toml"
    file.write_text("[plc]\nspeed = 3\n", encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "stepdiag.virtual", "--config", str(file)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert "speed" in ended.stderr


FOURDOF = """
time_scale = 20.0
[volume]
increments = 2
[program]
setups = ["fourdof-x"]
passes = 1
feed_mm_min = 10000.0
dwell_s = 8.0
pause_s = 4.0
[machine]
straightness_um = 30.0
[head]
"""


def frames_of(port, count=20):
    """Return the values of ``count`` binary frames, read as they come."""
    port.reset_input_buffer()
    received = b""

    def enough():
        nonlocal received
        received += port.read(4096)
        return len(received) > 46 * (count + 1)

    until(enough)
    start = received.index(b"\xf4\xd0i")
    return [
        struct.unpack_from("<9i", received, start + 46 * number + 8)
        for number in range(count)
    ]


def test_the_head_sees_its_run_and_is_dark_before(bench_of, master_of):
    bench = bench_of(FOURDOF.replace("pause_s", "handshake = true\npause_s"))
    client = master_of(bench)
    with serial.Serial(bench.addresses["head_link"], 115200, timeout=0.0) as port:
        assert max(abs(value) for frame in frames_of(port) for value in frame) < 100
        spots = []
        for count in (1, 2):
            until(lambda wanted=count: standing_at(client, wanted))
            time.sleep(0.1)
            frames = frames_of(port)
            client.write_register(100, count, device_id=1)
            assert all(abs(frame[2] - 1_000_000) < 100 for frame in frames)
            spots.append(sum(frame[0] / frame[2] for frame in frames) / len(frames))
        bench.inject(Fault(kind="head-blocked", duration_s=60.0))
        until(lambda: frames_of(port)[-1][2] < 100)
    assert abs(spots[0]) < 1e-4
    assert abs(spots[1]) > 1e-3
