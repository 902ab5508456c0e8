"""``stepdiag check`` against the virtual bench over real sockets and ptys: what a person on the
telephone is told."""

import json
import os
import pty
import subprocess
import sys
from contextlib import closing, suppress

import pytest

from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.config import load_config
from testkit.cli import joined, stepdiag

pytestmark = pytest.mark.system

BENCH = """
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[program]
start = "command"
"""
SURVEY = """
[survey]
name = "checked"
machine = "virtual"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[laser]
format = "umd"
port = "{laser}"
[plc]
port = {plc}
unit = {unit}
"""


@pytest.fixture
def bench_of(tmp_path):
    """Return a bench that runs, made from TOML; it ends with the test."""
    benches = []

    def made(text=""):
        bench = VirtualBench(load_config(BENCH + text), tmp_path)
        bench.start()
        benches.append(bench)
        return bench.addresses

    yield made
    for bench in benches:
        bench.close()


@pytest.fixture
def check(tmp_path):
    """Return what a check says: exit code, findings by code, and all of it."""

    def run(addresses, *, seconds=3, more="", **changed):
        places = {
            "laser": addresses.get("laser_link", ""),
            "plc": addresses.get("plc_port", 1),
            "unit": 1,
        } | changed
        survey = tmp_path / "survey.toml"
        survey.write_text(SURVEY.format(**places) + more, encoding="utf-8")
        done = stepdiag("check", survey, "--seconds", seconds, "--json")
        assert done.refusal == ""
        said = json.loads(done.out)
        return (
            done.code,
            {
                name: each
                for each in said["findings"]
                for name in (each["code"], each.get("key", each["code"]))
            },
            said,
        )

    return run


def test_a_bench_that_is_well(bench_of, check):
    code, findings, said = check(bench_of())
    assert code == 0
    assert not [each for each in findings.values() if each["severity"] == "error"]
    assert said["machine"]["signals"]["air_pressure_hpa"] == pytest.approx(1013.2)
    assert said["machine"]["changes"]["heartbeat"] >= 3
    assert said["laser"]["samples_per_s"] == pytest.approx(1000, rel=0.3), (
        "a busy computer is late with some"
    )
    assert "wrong-laser-sign" in findings, "standing, nobody can know the sign"


def test_a_person_sees_one_table_and_the_words(bench_of, tmp_path):
    addresses = bench_of()
    survey = tmp_path / "survey.toml"
    survey.write_text(
        SURVEY.format(laser=addresses["laser_link"], plc=addresses["plc_port"], unit=1),
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "stepdiag", "check", str(survey), "--seconds", "2"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "COLUMNS": "140"},
    )
    assert done.returncode == 0
    assert done.stdout.count("relative_humidity_percent") == 1
    assert "holding 2 bit 0" in done.stdout
    assert "note    wrong-laser-sign" in done.stdout


def test_ports_that_are_absent(bench_of, check):
    bench_of()
    code, findings, _ = check({}, laser="/dev/stepdiag-no-such-port")
    assert code == 4
    assert "No such file or directory" in findings["laser-unreachable"]["text"]
    assert "nothing listens on this port" in findings["machine-unreachable"]["text"]


def test_a_silent_laser_and_a_silent_plc(bench_of, check):
    addresses = bench_of(
        '[[fault]]\nkind = "plc-silent"\nduration_s = 60.0\n[[fault]]\nkind = '
        '"laser-silent"\nduration_s = 60.0\n'
    )
    code, findings, _ = check(addresses)
    assert code == 4
    assert (
        "check the power and the baud rate of the instrument"
        in findings["laser-silent"]["text"]
    )
    assert "silence" in findings["machine-silent"]["text"]


def test_a_unit_that_does_not_exist(bench_of, check):
    code, findings, _ = check(bench_of(), unit=9)
    assert code == 4
    assert "check the unit id (plc.unit)" in findings["machine-silent"]["text"]


def test_a_wrong_baud_rate_is_garbage(bench_of, check):
    code, findings, _ = check(bench_of('[[fault]]\nkind = "laser-baud"\nduration_s = 60.0\n'))
    assert code == 4
    assert "check baud rate" in findings["bytes-garbled"]["text"]


def test_an_exception_reply_names_its_meaning(bench_of, check):
    code, findings, _ = check(
        bench_of('[[fault]]\nkind = "plc-exception"\nvalue = 2\nduration_s = 60.0\n')
    )
    assert code == 4
    assert "exception 2 (illegal data address)" in findings["machine-silent"]["text"]


def test_a_register_map_that_does_not_fit(bench_of, check):
    more = "\n".join(f"[plc.signals.{name}]\n{place}" for name, place in MAP.items())
    code, findings, _ = check(bench_of(), more=more)
    assert code == 0, "stopped is served: a survey could be recorded"
    assert (
        "refuses to send alarm at holding 4000 bit 0"
        in findings["signals-absent.refused"]["text"]
    )
    assert "air_pressure_hpa at" in findings["signals-absent.implausible"]["text"]


MAP = {
    "stopped": 'address = 2\ntype = "bit"\n',
    "alarm": 'address = 4000\ntype = "bit"\n',
    "air_pressure_hpa": 'address = 11\nscale = 0.1\ntype = "float32"\norder = "CDAB"\n',
}


def test_a_control_that_hangs(bench_of, check):
    code, findings, _ = check(
        bench_of('[[fault]]\nkind = "plc-frozen"\nduration_s = 60.0\n'), seconds=5
    )
    assert code == 4
    assert "the program of the PLC is not running" in findings["heartbeat-still"]["text"]


def test_a_port_that_another_program_holds(bench_of, check):
    """A survey that is being recorded keeps its laser to itself."""
    addresses = bench_of()
    import serial

    with closing(serial.Serial(addresses["laser_link"], exclusive=True)):
        code, findings, _ = check(addresses, seconds=2)
    assert code == 4
    assert "another program has the port open" in findings["laser-unreachable"]["text"]


def test_on_a_terminal_the_table_lives(bench_of, tmp_path):
    addresses = bench_of()
    survey = tmp_path / "survey.toml"
    survey.write_text(
        SURVEY.format(laser=addresses["laser_link"], plc=addresses["plc_port"], unit=1),
        encoding="utf-8",
    )
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "stepdiag", "check", str(survey), "--seconds", "2"]
    process = subprocess.Popen(
        command,
        stdout=slave,
        stderr=slave,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "60"},
    )
    os.close(slave)
    shown = b""
    with suppress(OSError):
        while piece := os.read(master, 65536):
            shown += piece
    os.close(master)
    assert process.wait(timeout=120) == 0
    assert shown.count(b"heartbeat") > 3, "shown anew several times"


def test_a_survey_file_that_is_wrong_is_refused_before_any_port_is_opened(tmp_path):
    survey = tmp_path / "survey.toml"
    survey.write_text(SURVEY.format(laser="x", plc="70000", unit=1), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "stepdiag", "check", str(survey)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 2
    assert (
        "survey.toml: plc.port: expected a whole number from 1 to 65535, found 70000"
        in joined(done.stderr)
    )
