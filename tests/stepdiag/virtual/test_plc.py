"""The virtual PLC: the contract's block and the Modbus protocol, seen as bytes."""

import struct

import numpy as np
import pytest

from stepdiag.virtual.base.clock import Clock
from stepdiag.virtual.base.faults import Fault, FaultBoard
from stepdiag.virtual.drive.player import Drive, Player
from stepdiag.virtual.drive.program import Plan, steps
from stepdiag.virtual.drive.registers import PositionRegisters
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.physics.environment import Course, Environment
from stepdiag.virtual.plc.modbus import ModbusError, checksum, frame_length, respond
from stepdiag.virtual.plc.plc import Plc

HALL = Environment(
    material_c=Course(start=21.37),
    air_c=Course(start=-3.5),
    pressure_hpa=Course(start=987.6),
    humidity_percent=Course(start=45.5),
)


class StillClock(Clock):
    """A clock that a test sets."""

    def __init__(self):
        super().__init__(1.0)

    now = 0.0

    def wall_s(self):
        return StillClock.now


@pytest.fixture
def bench():
    StillClock.now = 0.0
    faults = FaultBoard()
    box = Box(origin_mm=(-200.0, 0.0, 0.0), size_mm=(100.0, 80.0, 60.0), increments=2)
    plan = Plan(box=box, setups=("pnp",), passes=1, dwell_s=1.0, pause_s=1.0)
    drive = Drive()
    player = Player(steps(plan, faults), drive)

    def plc(**options):
        return Plc(
            player, drive, HALL, clock=StillClock(), faults=faults, scan_s=0.01, **options
        )

    return plc, player, faults


def stand(player, stop):
    """Let time pass to the middle of a dwell."""
    moment = 0.0
    while not ((at := player.advance(moment)).step.kind == "dwell" and at.step.stop == stop):
        moment += 0.1
    StillClock.now = at.start_s + 0.5


def test_the_block_says_what_the_contract_says(bench):
    plc, player, _ = bench
    stand(player, 1)
    block = plc().read("holding", 0, 14)
    assert block[1:4] == [2, 0b011, 3]
    positions = struct.unpack(">3i", struct.pack(">6H", *block[4:10]))
    assert positions == (-1500000, 800000, 0)
    assert struct.unpack(">2h", struct.pack(">2H", *block[10:12])) == (2137, -350)
    assert list(block[12:]) == [9876, 455]
    assert plc().read("input", 1, 2) == block[1:3]
    assert list(plc().read("coil", 0, 3)) == [1, 1, 0]


def positions_mm(plc):
    words = plc.read("holding", 4, 6)
    return 1e-4 * np.array(struct.unpack(">3i", struct.pack(">6H", *words)))


def test_actual_positions_scatter_from_scan_to_scan(bench):
    plc, player, _ = bench
    stand(player, 1)
    one = plc(registers=PositionRegisters(shows="actual", scatter_um=1.0), seed=3)
    seen = []
    for _ in range(40):
        seen.append(positions_mm(one))
        assert positions_mm(one).tolist() == seen[-1].tolist(), "one scan has one image"
        StillClock.now += 0.01
    off = 1e3 * (np.array(seen) - [-150.0, 80.0, 0.0])
    assert np.std(off) == pytest.approx(1.0, rel=0.2)
    assert np.max(np.abs(off)) < 5.0


def test_actual_positions_show_the_standstill_of_the_axes():
    StillClock.now = 0.0
    faults = FaultBoard()
    plan = Plan(
        box=Box(size_mm=(100.0, 80.0, 60.0), increments=2),
        setups=("pnp",),
        passes=1,
        dwell_s=1.0,
        pause_s=1.0,
    )
    drive = Drive(servo_um=3.0, repeatability_um=50.0)
    player = Player(steps(plan, faults), drive, seed=2)
    stand(player, 1)
    shown = []
    for shows in ("commanded", "actual"):
        registers = PositionRegisters(shows=shows, resolution_mm=1e-3)
        shown.append(
            positions_mm(
                Plc(
                    player,
                    drive,
                    HALL,
                    clock=StillClock(),
                    faults=faults,
                    registers=registers,
                )
            )
        )
    assert shown[0] == pytest.approx([50.0, 80.0, 0.0])
    off_um = 1e3 * (shown[1] - shown[0])
    assert 0.0 < np.max(np.abs(off_um)) < 15.0
    assert off_um == pytest.approx(np.round(off_um), abs=1e-6)


def test_the_heartbeat_changes_within_a_second(bench):
    plc, _, _ = bench
    beats = []
    for tenth in range(40):
        StillClock.now = tenth / 10.0
        beats.append(plc().read("holding", 0, 1)[0])
    assert all(len(set(beats[start : start + 11])) > 1 for start in range(29))


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ("ABCD", [0xFFE9, 0x1CA0]),
        ("CDAB", [0x1CA0, 0xFFE9]),
        ("BADC", [0xE9FF, 0xA01C]),
        ("DCBA", [0xA01C, 0xE9FF]),
    ],
)
def test_positions_come_in_the_byte_order_of_the_plc(bench, order, words):
    """-1500000 is FFE91CA0h."""
    plc, player, _ = bench
    stand(player, 1)
    assert list(plc(order=order, base=40).read("holding", 44, 2)) == words


def test_a_rebooted_plc_counts_from_zero_again(bench):
    plc, player, _ = bench
    one = plc()
    stand(player, 2)
    assert one.read("holding", 1, 1) == [3]
    one.reboot()
    assert one.read("holding", 1, 1) == [0]
    stand(player, 3)
    assert one.read("holding", 1, 1) == [1]


def test_a_frozen_plc_repeats_its_last_image(bench):
    plc, player, faults = bench
    one = plc()
    stand(player, 1)
    faults.inject(Fault(kind="plc-frozen", duration_s=100.0), 0.0)
    before = one.read("holding", 0, 14)
    stand(player, 4)
    assert one.read("holding", 0, 14) == before


def test_addresses_outside_the_block_and_writes_are_refused(bench):
    plc, _, _ = bench
    for table, address, count in (("holding", 13, 2), ("holding", 99, 1), ("coil", 2, 2)):
        with pytest.raises(ModbusError, match="exception 2"):
            plc().read(table, address, count)
    with pytest.raises(ModbusError, match="exception 2"):
        plc().write("holding", 0, [1])


def test_the_handshake_register_is_kept(bench):
    plc, _, _ = bench
    one = plc()
    assert respond(one, bytes.fromhex("06 0064 0005")) == bytes.fromhex("06 0064 0005")
    assert respond(one, bytes.fromhex("03 0064 0001")) == bytes.fromhex("03 02 0005")


class Registers:
    """Holding registers 107 and 108 of the specification's example, and its coils 20 to 38."""

    def __init__(self):
        self.written = {}

    def read(self, table, address, count):
        if table == "coil":
            bits = [1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1]
            return bits[:count]
        return [0x022B, 0x0000, 0x0064][:count]

    def write(self, table, address, values):
        self.written[table, address] = list(values)


@pytest.mark.parametrize(
    ("request_hex", "response_hex"),
    [
        ("03 006B 0003", "03 06 022B 0000 0064"),
        ("01 0013 0013", "01 03 CD 6B 05"),
        ("10 0001 0002 04 000A 0102", "10 0001 0002"),
        ("17 0003 0003 000E 0001 02 00FF", "17 06 022B 0000 0064"),
        ("05 00AC FF00", "05 00AC FF00"),
        ("07", "87 01"),
        ("03 006B 0000", "83 03"),
        ("03 006B", "83 03"),
    ],
)
def test_requests_are_answered_as_in_the_specification(request_hex, response_hex):
    """Modbus Application Protocol V1.1b3, the examples of sections 6.1, 6.3, 6.5, 6.12, 6.17;
    exceptions 1 and 3 of section 7."""
    assert respond(Registers(), bytes.fromhex(request_hex)) == bytes.fromhex(response_hex)


def test_the_checksum_is_that_of_the_serial_line_specification():
    """Modbus over Serial Line V1.02, appendix B: 02 07 has the CRC 41 12."""
    assert checksum(bytes.fromhex("0207")) == bytes.fromhex("4112")


def test_the_length_of_a_serial_request_is_known_from_its_beginning():
    assert frame_length(b"\x01") is None
    assert frame_length(bytes.fromhex("01 03 0000 0001")) == 8
    assert frame_length(bytes.fromhex("01 10 0001 0001")) is None
    assert frame_length(bytes.fromhex("01 10 0001 0001 02")) == 11
    assert frame_length(bytes.fromhex("01 17 0000 0001 0000 0001 02")) == 15
