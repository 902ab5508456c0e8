"""What ``stepdiag check`` says about streams and register maps, fed by hand: every cause has words
of its own."""

import io
import struct

import pytest
from rich.console import Console

from stepdiag.checking.diagnosis import diagnose
from stepdiag.checking.tables import check_table
from stepdiag.daq.formats.signals import plan_reads
from stepdiag.daq.records.events import Chunk, LinkEvent, ModbusBlock
from testkit.checked import LINE_SURVEY, seen_of

S = 1_000_000_000


def told(seen, severity=None):
    """Return code and key -> text."""
    found = [each for each in diagnose(seen) if severity in (None, each.severity)]
    return {each.code: each.text for each in found} | {each.key: each.text for each in found}


def registers(heartbeat=0, *, setup=0, x=0, material=2000, pressure=10132):
    return struct.pack(
        ">HHHHiiihhHH", heartbeat, 1, 1, setup, x, 0, 0, material, 2000, pressure, 500
    )


def answer(seen, at_s, data):
    at = int(at_s * S)
    ranges = plan_reads(seen.survey.plc.signals)
    seen.take(
        ModbusBlock(at, at + 2_000_000, ranges, (data,) if isinstance(data, bytes) else data)
    )


def machine_is_well(seen, seconds=5.0, **values):
    seen.take(LinkEvent(0, "machine", "connected", "there"))
    for poll in range(int(seconds * 50)):
        answer(seen, 1 + poll / 50, registers(poll // 25, **values))


def laser_is_well(seen, seconds=5.0, beam=0.9, line="{0:.6f} {1} {2}\n"):
    seen.take(LinkEvent(0, "laser", "connected", "there"))
    for sample in range(int(seconds * 100)):
        seen.take(
            Chunk(
                "laser", int((1 + sample / 100) * S), line.format(12.5, sample, beam).encode()
            )
        )


@pytest.fixture
def seen():
    observed = seen_of(LINE_SURVEY)
    observed.seconds = 5.0
    return observed


def test_all_is_well(seen):
    laser_is_well(seen)
    machine_is_well(seen)
    assert told(seen).keys() == {"wrong-laser-sign", "wrong-laser-sign.unseen"}


def test_a_name_of_a_signal_stands_on_one_line_of_80_columns(seen):
    """It is copied into [plc.signals]; the columns beside it give way."""
    laser_is_well(seen)
    machine_is_well(seen)
    console = Console(width=80, file=io.StringIO())
    console.print(check_table(seen))
    rows = [line for line in console.file.getvalue().splitlines() if "│" in line]
    assert set(seen.survey.plc.signal_names) <= {row.split("│")[1].strip() for row in rows}


@pytest.mark.parametrize("answer", ['compensation = "?"', ""])
def test_whether_a_compensation_is_active_is_asked_until_it_is_answered(answer):
    seen = seen_of(LINE_SURVEY.replace('compensation = "off"', answer))
    assert "machine.compensation" in told(seen, "warning")["compensation-unanswered"]


class TestLaser:
    def test_what_cannot_be_opened_is_told_as_the_port_says_it(self, seen):
        seen.take(
            LinkEvent(
                0, "laser", "lost", "serial port laser: found No such file or directory"
            )
        )
        assert (
            told(seen, "error")["laser-unreachable"]
            == "serial port laser: found No such file or directory"
        )

    def test_a_line_without_a_byte(self, seen):
        seen.take(LinkEvent(0, "laser", "silent", "laser: no byte for 2 s"))
        assert "no byte" in told(seen, "error")["laser-silent"]

    def test_bytes_that_make_no_sense_are_a_wrong_baud_rate_or_format(self, seen):
        for at in range(40):
            seen.take(Chunk("laser", at * S // 10, b"\xf8\x00\x9c\xe0\n" * 5))
        assert "check baud rate, format" in told(seen, "error")["bytes-garbled"]

    def test_some_garbage_is_a_cable(self, seen):
        laser_is_well(seen)
        for at in range(30):
            seen.take(Chunk("laser", 6 * S + at, b"12.5 \x00\xff\n"))
        assert "check the cable" in told(seen, "warning")["bytes-garbled"]

    @pytest.mark.parametrize(
        ("beam", "code"), [(0.05, "beam-lost"), (0.3, "instrument-reports.weak-beam")]
    )
    def test_the_beam_is_judged_by_its_strength(self, seen, beam, code):
        laser_is_well(seen, beam=beam)
        assert f"({100 * beam:.0f} %)" in told(seen, "warning")[code]

    def test_a_slow_instrument_is_measured_against_its_rate(self, seen):
        laser_is_well(seen_fast := seen_of(LINE_SURVEY + "rate_hz = 200.0\n"))
        seen_fast.seconds = 5.0
        assert (
            "sends 100.0 samples per second instead of 200.0"
            in told(seen_fast, "warning")["samples-missing.rate"]
        )

    def test_a_link_that_came_back_is_unsteady_and_one_that_did_not_is_an_error(self, seen):
        laser_is_well(seen)
        seen.take(LinkEvent(6 * S, "laser", "lost", "it is gone"))
        assert "it is gone" in told(seen, "error")["laser-silent"]
        seen.take(LinkEvent(7 * S, "laser", "connected", "there"))
        assert "lost 1 times" in told(seen, "warning")["laser-unsteady"]


class TestMachine:
    def test_a_heartbeat_that_stands_still(self, seen):
        for poll in range(200):
            answer(seen, 1 + poll / 50, registers(7))
        assert "has had the value 7 for 4 s" in told(seen, "error")["heartbeat-still"]

    def test_a_heartbeat_that_is_too_slow(self, seen):
        for poll in range(400):
            answer(seen, 1 + poll / 50, registers(poll // 200))
        assert "changed 1 times in 8 s" in told(seen, "warning")["heartbeat-still.slow"]

    @pytest.mark.parametrize(
        ("values", "signal"),
        [
            ({"x": 0x7F000000}, None),
            ({"x": -(2**31)}, "x_mm"),
            ({"material": -30000}, "material_temperature_c"),
            ({"pressure": 9}, "pressure"),
        ],
    )
    def test_values_that_no_machine_can_have_point_at_the_register_map(
        self, seen, values, signal
    ):
        machine_is_well(seen, **values)
        text = told(seen, "warning").get("signals-absent.implausible", "")
        assert (signal or "x_mm") in text
        assert "check address, type, order and scale" in text

    def test_a_setup_number_that_does_not_exist(self, seen):
        machine_is_well(seen, setup=77)
        assert (
            "the signal setup is 77" in told(seen, "warning")["signals-absent.setup-number"]
        )

    def test_an_answer_of_another_length(self, seen):
        answer(seen, 1, b"\x00\x01")
        assert "expected 28 bytes, found 2" in told(seen, "error")["bytes-garbled"]

    def test_polls_that_come_too_slowly(self, seen):
        for poll in range(50):
            answer(seen, 1 + poll / 10, registers(poll))
        assert (
            "answers 10 polls per second instead of 50"
            in told(seen, "warning")["samples-missing.polls"]
        )

    def test_what_is_not_mapped_is_said_with_what_it_costs(self):
        seen = seen_of(
            LINE_SURVEY + '[plc.signals.stopped]\ntable = "coil"\naddress = 3\ntype = "bit"\n'
        )
        seen.seconds = 5.0
        answer(seen, 1, b"\x01")
        notes = [each for each in diagnose(seen) if each.code == "signals-absent"]
        assert len(notes) == 10
        assert (
            notes[2].text
            == "without the signal heartbeat, a control that no longer renews its signals is "
            "not noticed"
        )

    def test_the_indispensable_signal_refused_is_an_error_any_other_a_warning(self):
        extra = (
            '[plc.signals.stopped]\naddress = 3\ntype = "bit"\n[plc.signals.alarm]\naddress = '
            '90\ntype = "bit"\n'
        )
        for refused, severity in (
            ((b"", b"\x00\x00", b""), "error"),
            ((b"\x00\x00", b"", b"\x00\x00"), "warning"),
        ):
            seen = seen_of(LINE_SURVEY + extra)
            seen.take(
                LinkEvent(0, "machine", "connected", "exception 2 (illegal data address)")
            )
            answer(seen, 1, refused)
            assert "illegal data address" in told(seen, severity)["signals-absent.refused"]
