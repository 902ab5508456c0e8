"""Registers -> signals, against bytes as they stand on the wire."""

import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import DataError
from stepdiag.daq.formats.signals import (
    CONTRACT_SIGNALS,
    MAX_REGISTERS,
    SignalDecoder,
    Signals,
    SignalSpec,
    describe,
    plan_reads,
    registers,
)
from stepdiag.daq.records.events import ModbusBlock, ReadRange

CONTRACT_BLOCK = bytes.fromhex(
    "0007"  # heartbeat
    "002a"  # stop_count
    "0003"  # stopped and running
    "0002"  # npp
    "004c4b40"  # X 500 mm in 0.1 µm
    "ffb3b4c0"  # Y -500 mm
    "00000001"  # Z 0.1 µm
    "0834"  # 21.00 C
    "ff9c"  # -1.00 C
    "2794"  # 1013.2 hPa
    "01f4"  # 50.0 %
)


def block(signals: dict[str, SignalSpec], *data: bytes) -> ModbusBlock:
    return ModbusBlock(0, 1, plan_reads(signals), data)


def value(spec: SignalSpec, data: bytes) -> float | None:
    return SignalDecoder({"x_mm": spec}).decode(block({"x_mm": spec}, data)).x_mm


def test_contract_block_is_one_request_and_reads_as_written() -> None:
    """contract.md 2: fourteen holding registers from 0, ABCD, 0.1 µm, 0.01 C, 0.1 hPa, 0.1 %."""
    assert plan_reads(CONTRACT_SIGNALS) == (ReadRange("holding", 0, 14),)
    signals = SignalDecoder(CONTRACT_SIGNALS).decode(
        block(dict(CONTRACT_SIGNALS), CONTRACT_BLOCK)
    )
    assert (signals.heartbeat, signals.stop_count, signals.setup) == (7, 42, 2)
    assert (signals.stopped, signals.running, signals.alarm) == (True, True, False)
    assert signals.commanded_mm == pytest.approx((500.0, -500.0, 0.0001))
    assert signals.material_temperature_c == pytest.approx(21.0)
    assert signals.air_temperature_c == pytest.approx(-1.0)
    assert signals.air_pressure_hpa == pytest.approx(1013.2)
    assert signals.relative_humidity_percent == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("order", "wire"),
    [("ABCD", "12345678"), ("CDAB", "56781234"), ("BADC", "34127856"), ("DCBA", "78563412")],
)
def test_byte_orders_on_the_wire(order: str, wire: str) -> None:
    """0x12345678 with A the most significant byte; MELSEC sends CDAB (instruments.md 4.1)."""
    spec = SignalSpec(address=0, type="uint32", order=order)  # type: ignore[arg-type]
    assert value(spec, bytes.fromhex(wire)) == 0x12345678


@pytest.mark.parametrize(
    ("kind", "order", "wire", "expected"),
    [
        ("int32", "ABCD", "fffffffe", -2),
        ("int32", "DCBA", "feffffff", -2),
        ("uint32", "ABCD", "fffffffe", 4294967294),
        ("int16", "ABCD", "8000", -32768),
        ("uint16", "CDAB", "1234", 0x1234),
        ("uint16", "BADC", "3412", 0x1234),
        ("int16", "DCBA", "feff", -2),
        ("float32", "ABCD", "42f6e979", 123.456),
        ("float32", "CDAB", "e97942f6", 123.456),
        ("float32", "BADC", "f64279e9", 123.456),
        ("float32", "DCBA", "79e9f642", 123.456),
    ],
)
def test_numbers_on_the_wire(kind: str, order: str, wire: str, expected: float) -> None:
    """IEEE 754 single: 0x42F6E979 is 123.456."""
    spec = SignalSpec(address=0, type=kind, order=order)  # type: ignore[arg-type]
    assert value(spec, bytes.fromhex(wire)) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("wire", ["7fc00000", "7f800000", "ff800000"])
def test_a_float_that_is_no_number_is_unknown(wire: str) -> None:
    assert value(SignalSpec(address=0, type="float32"), bytes.fromhex(wire)) is None


def test_scale_and_offset() -> None:
    spec = SignalSpec(address=0, type="int16", scale=0.5, offset=-10.0)
    assert value(spec, b"\x00\x64") == 40.0


@pytest.mark.parametrize("place", range(17))
def test_a_coil_is_found_in_its_byte(place: int) -> None:
    decoder = SignalDecoder(
        {"stopped": SignalSpec(table="coil", address=100 + place, type="bit")}
    )
    asked = (ReadRange("coil", 100, 24),)
    alone, beside = (
        (1 << place).to_bytes(3, "little"),
        (0xFFFFFF ^ 1 << place).to_bytes(3, "little"),
    )
    assert decoder.decode(ModbusBlock(1, 2, asked, (alone,))).stopped
    assert not decoder.decode(ModbusBlock(1, 2, asked, (beside,))).stopped


def test_bits_of_coils_registers_and_numbers() -> None:
    """Coils come packed, least significant bit first (Modbus application protocol V1.1b3, 6.1)."""
    signals = {
        "stopped": SignalSpec(table="coil", address=19, type="bit"),
        "running": SignalSpec(table="discrete", address=3, type="bit"),
        "alarm": SignalSpec(address=5),
    }
    asked = (
        ReadRange("coil", 10, 10),
        ReadRange("discrete", 3, 1),
        ReadRange("holding", 5, 1),
    )
    decoder = SignalDecoder(signals)
    on = decoder.decode(ModbusBlock(0, 1, asked, (b"\x00\x02", b"\x01", b"\x00\x05")))
    off = decoder.decode(ModbusBlock(0, 1, asked, (b"\xff\x01", b"\x00", b"\x00\x00")))
    assert (on.stopped, on.running, on.alarm) == (True, True, True)
    assert (off.stopped, off.running, off.alarm) == (False, False, False)


def test_a_refused_range_leaves_the_others_alone() -> None:
    """One illegal address must not lose the whole poll (acquisition.md B1)."""
    signals = {
        "stopped": SignalSpec(address=2, type="bit"),
        "x_mm": SignalSpec(address=40, type="int32"),
    }
    read = SignalDecoder(signals).decode(block(signals, b"\x00\x01", b"", b"\x00\x01"))
    assert read == Signals(stopped=True)
    assert read.commanded_mm is None


def test_requests_join_only_what_touches() -> None:
    signals = {
        "stopped": SignalSpec(address=2, type="bit"),
        "running": SignalSpec(address=2, type="bit", bit=1),
        "x_mm": SignalSpec(address=3, type="int32"),
        "y_mm": SignalSpec(address=6, type="int32"),
        "z_mm": SignalSpec(table="input", address=5, type="int32"),
    }
    ranges = (
        ReadRange("holding", 2, 3),
        ReadRange("holding", 6, 2),
        ReadRange("input", 5, 2),
    )
    assert (
        plan_reads({name: spec for name, spec in signals.items() if name != "stopped"})
        == ranges
    )
    assert plan_reads(signals) == (*ranges, ReadRange("holding", 2, 1))


def test_a_machine_that_leaves_between_two_requests_does_not_stand() -> None:
    """Its position belongs to the move: read between a ``stopped`` that still stood and one that
    does not any more, or the other way."""
    signals = {
        "x_mm": SignalSpec(address=40, type="int32"),
        "stopped": SignalSpec(table="discrete", address=7, type="bit"),
    }
    assert [asked.table for asked in plan_reads(signals)] == [
        "discrete",
        "holding",
        "discrete",
    ]
    position = bytes.fromhex("00000064")
    decoder = SignalDecoder(signals)
    seen = [
        decoder.decode(block(signals, first, position, last)).stopped
        for first in (b"\x00", b"\x01")
        for last in (b"\x00", b"\x01")
    ]
    assert seen == [False, False, False, True]


def test_a_number_asked_for_twice_in_one_poll_is_the_first_that_came() -> None:
    """It shares the register of the stop bit, which is asked for at the end once more; where the
    first was refused, the second stands."""
    signals = {
        "setup": SignalSpec(address=2),
        "stopped": SignalSpec(address=2, type="bit"),
        "x_mm": SignalSpec(address=40, type="int32"),
    }
    decoder, position = SignalDecoder(signals), bytes.fromhex("00000064")
    assert decoder.decode(block(signals, bytes([0, 3]), position, bytes([0, 5]))).setup == 3
    assert decoder.decode(block(signals, b"", position, bytes([0, 5]))).setup == 5


def test_answer_of_another_length_is_refused() -> None:
    with pytest.raises(DataError, match=r"answer for holding 0: expected 28 bytes, found 26"):
        SignalDecoder(CONTRACT_SIGNALS).decode(
            block(dict(CONTRACT_SIGNALS), CONTRACT_BLOCK[:26])
        )


def test_block_of_another_map_is_refused_by_signal() -> None:
    foreign = ModbusBlock(0, 1, (ReadRange("holding", 0, 4),), (bytes(8),))
    with pytest.raises(
        DataError,
        match=r"signal x_mm: expected a recorded block that contains holding 4-5, "
        r"found holding 0\+4",
    ):
        SignalDecoder(CONTRACT_SIGNALS).decode(foreign)


def test_places_in_words() -> None:
    assert describe(SignalSpec(address=2, type="bit", bit=3)) == "holding 2 bit 3"
    assert describe(SignalSpec(table="coil", address=7, type="bit")) == "coil 7"
    assert describe(SignalSpec(address=40, type="float32", table="input")) == "input 40-41"


SPECS = st.builds(
    SignalSpec,
    address=st.integers(0, 400),
    table=st.sampled_from(["holding", "input"]),
    type=st.sampled_from(["uint16", "int16", "uint32", "int32", "float32"]),
)


@given(st.lists(SPECS, min_size=1, max_size=40))
def test_every_signal_is_read_once_within_the_limits(specs: list[SignalSpec]) -> None:
    """Each number lies whole in one request, and nothing is asked that no signal needs."""
    ranges = plan_reads({str(index): spec for index, spec in enumerate(specs)})
    asked = [(one.table, one.address + place) for one in ranges for place in range(one.count)]
    assert set(asked) == registers(specs)
    assert all(one.count <= MAX_REGISTERS for one in ranges)
    for spec in specs:
        assert any(
            one.table == spec.table
            and one.address <= spec.address
            and spec.address + spec.width <= one.address + one.count
            for one in ranges
        )


@given(st.binary(min_size=28, max_size=28), st.binary(min_size=28, max_size=28))
def test_decoding_depends_on_the_block_alone(first: bytes, second: bytes) -> None:
    """What was decoded before does not show: a decoder that remembers equals a fresh one."""
    used = SignalDecoder(CONTRACT_SIGNALS)
    signals = dict(CONTRACT_SIGNALS)
    used.decode(block(signals, first))
    assert used.decode(block(signals, second)) == SignalDecoder(CONTRACT_SIGNALS).decode(
        block(signals, second)
    )


def test_unknown_settings_of_a_signal_are_refused_by_the_struct() -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"address": 1, "adress": 2}, SignalSpec)


def test_in_a_data_block_and_in_a_tncs_memory_an_address_is_a_byte():
    """DB4900.DBW0, DBX5.0 and DBD8, most significant byte first; D284 and a bit of W1026, low byte
    first."""
    s7 = {
        "setup": SignalSpec(table="db4900", address=0),
        "stopped": SignalSpec(table="db4900", address=5, type="bit"),
        "x_mm": SignalSpec(table="db4900", address=6, type="int32", scale=1e-4),
    }
    asked = plan_reads(s7, ())
    assert asked == (ReadRange("db4900", 0, 2), ReadRange("db4900", 5, 5))
    decoded = SignalDecoder(s7).decode(
        ModbusBlock(0, 1, asked, (b"\x00\x0b", b"\x01" + struct.pack(">i", -123456)))
    )
    assert (decoded.setup, decoded.stopped, decoded.x_mm) == (
        11,
        True,
        pytest.approx(-12.3456),
    )
    tnc = {
        "stop_count": SignalSpec(table="B", address=284, type="int32", order="DCBA"),
        "stopped": SignalSpec(table="B", address=1026, type="bit", bit=2),
    }
    asked = plan_reads(tnc, ())
    assert asked == (ReadRange("B", 284, 4), ReadRange("B", 1026, 1))
    decoded = SignalDecoder(tnc).decode(
        ModbusBlock(0, 1, asked, (b"\x01\x02\x00\x00", b"\x04"))
    )
    assert (decoded.stop_count, decoded.stopped) == (513, True)


def test_what_the_machine_refused_is_known_by_name():
    signals = {
        "setup": SignalSpec(address=0),
        "stopped": SignalSpec(table="coil", address=0, type="bit"),
    }
    decoder, asked = SignalDecoder(signals), plan_reads(signals, ())
    block = ModbusBlock(
        0, 1, asked, tuple(b"" if each.table == "coil" else b"\0\1" for each in asked)
    )
    decoder.decode(block)
    assert decoder.unanswered(block) == ("stopped",)


@given(
    polls=st.lists(
        st.dictionaries(
            st.integers(0, len(CONTRACT_BLOCK) - 1), st.integers(0, 255), max_size=4
        ),
        min_size=2,
        max_size=6,
    ),
    refused=st.sets(st.integers(0, 5)),
)
def test_a_decoder_of_many_polls_decodes_each_as_a_new_one_does(polls, refused):
    """It decodes a signal again only where the signal's own bytes have changed."""
    decoder = SignalDecoder(CONTRACT_SIGNALS)
    for number, changes in enumerate(polls):
        data = bytearray(CONTRACT_BLOCK)
        for at, value in changes.items():
            data[at] = value
        poll = block(CONTRACT_SIGNALS, b"" if number in refused else bytes(data))
        assert decoder.decode(poll) == SignalDecoder(CONTRACT_SIGNALS).decode(poll)
