"""A laser on the network: binary frames over TCP, a board behind a terminal server; lost, killed,
replayed to the same bytes."""

import json
import os
import signal

import pytest

from testkit.cli import stepdiag
from testkit.running.hall import daemon, hall, until
from testkit.running.survey_runs import drive_and_replay
from testkit.running.terminal_server import terminal_server
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

FRAMES = """
[laser.frames]
sync = "AA55"
layout = ["counter u16", "position i32", "beam u16", "status u8"]
byte_order = "{order}"
checksum = "crc-16/modbus"
checksum_order = "little"
unit = "nm"
beam_full = 1000.0
lost_bits = 1
rate_hz = 500.0
"""


def frames(order):
    bench = f'rate_hz = 500.0\nwire = "tcp"\nbyte_order = "{order}"\n'
    return {
        "laser": "frames",
        "laser_bench": bench,
        "laser_survey": FRAMES.format(order=order),
        "handshake": True,
        "dwell": 0.5,
        "n": 1,
    }


@pytest.mark.impatient
def test_a_survey_with_binary_frames_over_tcp_is_recorded_solved_and_replayed_to_the_same_bytes(
    tmp_path,
):
    with hall(tmp_path, **frames("big")) as place:
        drive_and_replay(place)


def test_a_connection_that_ends_in_the_middle_of_a_frame_and_a_killed_daemon_cost_nothing_silently(
    tmp_path,
):
    """The instrument loses its supply in a move of the first setup; in the second the daemon is
    killed."""
    cut = (
        '[[fault]]\nkind = "laser-unplug"\nsetup = "npp"\nstop = 2\nphase = "move"\nduration_s = '
        "0.3\n"
    )
    with hall(tmp_path, faults=cut, **frames("little")) as place:
        with daemon(place.survey) as process:
            place.start_setups(stop_after=1)
            until(process, "stop", stop=2)
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        with daemon(place.survey) as process:
            place.setups = place.setups[1:]
            place.start_setups()
            until(
                process,
                "pass-ended",
                reason="diagonal X-Y-Z+ to X+Y+Z- (ppn) out: stop 4 is past",
            )
        book = nothing_silently_wrong(place)
        assert book.doubts()


@pytest.mark.impatient
def test_a_board_behind_a_terminal_server_is_read_as_if_it_were_plugged_in(tmp_path):
    """RFC 2217 by the library's own server side; check says how the line is set, and the survey is
    whole."""
    with (
        hall(tmp_path, handshake=True, dwell=0.5, n=1) as place,
        terminal_server(str(tmp_path / "devices" / "laser"), "rfc2217") as name,
    ):
        place.survey.write_text(
            place.survey.read_text().replace(str(tmp_path / "devices" / "laser"), name)
        )
        code, out, said = stepdiag("check", place.survey, "--seconds", "2", "--json")
        assert code == 0, said
        assert (
            "115200 baud 8N1 set at the terminal server" in json.loads(out)["laser"]["detail"]
        )
        drive_and_replay(place)


@pytest.mark.impatient
def test_modbus_rtu_behind_a_terminal_server_records_a_whole_survey(tmp_path):
    """The control's serial line comes over the network as plain bytes; every pass is whole, the
    replay the same."""
    with hall(
        tmp_path, transport="rtu", poll_hz=40.0, handshake=True, dwell=0.5, n=1
    ) as place:
        line = str(tmp_path / "devices" / "plc")
        with terminal_server(line, "socket") as name:
            text = place.survey.read_text()
            assert f'serial_port = "{line}"' in text
            place.survey.write_text(
                text.replace(
                    f'serial_port = "{line}"', f'serial_port = "{name}"\ntimeout_s = 5.0'
                )
            )
            drive_and_replay(place)
        nothing_silently_wrong(place)


def test_check_quotes_frames_that_never_match(tmp_path):
    """Another instrument on the port: no reading, and the bytes are shown."""
    with hall(tmp_path, **frames("little")) as place:
        place.survey.write_text(
            place.survey.read_text().replace('sync = "AA55"', 'sync = "AA56"')
        )
        code, out, _ = stepdiag("check", place.survey, "--seconds", "2", "--json")
    found = {each["code"]: each["text"] for each in json.loads(out)["findings"]}
    assert code == 4
    assert "aa 55" in found["bytes-garbled"]
