"""``stepdiag setup`` as a person meets it: on a terminal, and by options alone; what it writes
passes ``check``."""

import codecs
import io
import math
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import click
import pytest

from stepdiag.base.errors import UsageError
from stepdiag.checking import hearing
from stepdiag.checking.hearing import Heard
from stepdiag.cli.setup import setup
from stepdiag.daq.links.controls import s7
from stepdiag.daq.survey.file import load_survey
from stepdiag.virtual.base.reserved import reserved_port
from testkit.cli import stepdiag
from testkit.running.controls import s7_control, tnc_control
from testkit.running.hall import hall

pytestmark = pytest.mark.system

AGAIN_S = 20.0
VOLUME = (
    "--machine",
    "virtual",
    "--size",
    "300,200,100",
    "--increments",
    "2",
    "--compensation",
    "off",
)


class Person:
    """Sits at a terminal: waits for what is said, answers."""

    def __init__(self, process, terminal):
        self.process, self.seen, self._terminal = process, "", terminal
        self._decode = codecs.getincrementaldecoder("utf-8")().decode

    def answers(self, question, answer):
        before = len(self.seen)
        end = time.monotonic() + 120.0
        while question not in self.seen[before:]:
            assert time.monotonic() < end, self.seen
            self._look()
        os.write(self._terminal, f"{answer}\n".encode())

    def leaves_it(self, words):
        """Press Ctrl-C once something has been said, and again where that is lost: Python misses
        one between a question and its reading."""
        end = time.monotonic() + 120.0
        while words not in self.seen:
            assert time.monotonic() < end, self.seen
            self._look()
        pressed = -math.inf
        while self.process.poll() is None:
            assert time.monotonic() < end, self.seen
            if time.monotonic() - pressed >= AGAIN_S:
                pressed = time.monotonic()
                self.process.send_signal(signal.SIGINT)
            self._look()

    def leaves(self):
        """Return the exit code once everything has been said."""
        end = time.monotonic() + 120.0
        while self.process.poll() is None:
            assert time.monotonic() < end, self.seen
            self._look()
        self._look()
        return self.process.returncode

    def _look(self):
        if select.select([self._terminal], [], [], 0.1)[0]:
            try:
                self.seen += self._decode(os.read(self._terminal, 65536))
            except OSError:  # the other end is closed
                time.sleep(0.05)


@contextmanager
def at_a_terminal(*arguments):
    near, far = pty.openpty()
    # a suite that was started in the background hands on that Ctrl-C is ignored; who sits at a
    # terminal has it
    command = [
        "env",
        "--default-signal=INT",
        sys.executable,
        "-m",
        "stepdiag",
        *map(str, arguments),
    ]
    process = subprocess.Popen(
        command,
        stdin=far,
        stdout=far,
        stderr=far,
        env=os.environ | {"COLUMNS": "160", "TERM": "dumb"},
    )
    os.close(far)
    try:
        yield Person(process, near)
    finally:
        process.kill()
        process.wait()
        os.close(near)


def modbus_port(place):
    return int(re.search(r"\[plc\]\nport = (\d+)", place.survey.read_text())[1])


def laser_port(place):
    return re.search(r'^port = "(.+)"', place.survey.read_text(), re.MULTILINE)[1]


def gives_up_soon_on(monkeypatch, *controls):
    """Have `setup` wait half a second for these controls, which nobody speaks there; who does
    answer has the usual time."""
    asked, usual_s = hearing._asked, hearing.ANSWER_S

    async def hurried(control, host, tcp_port):
        monkeypatch.setattr(hearing, "ANSWER_S", 0.5 if control in controls else usual_s)
        return await asked(control, host, tcp_port)

    monkeypatch.setattr(hearing, "_asked", hurried)
    if "siemens-828d" in controls:
        monkeypatch.setattr(s7, "CONNECT_S", 0.5)


def test_questions_on_a_terminal_lead_to_a_file_that_check_passes(tmp_path):
    """The laser is recognised, the control found by its protocol, a slip of the tongue is asked
    again."""
    file = tmp_path / "mill.toml"
    with (
        hall(tmp_path) as place,
        at_a_terminal("setup", file, "--port", modbus_port(place), "--seconds", 6) as person,
    ):
        person.answers("Port of the laser", laser_port(place))
        person.answers("Name or address of the control", "127.0.0.1")
        person.answers("Kind of control", "modbus")
        person.answers("Name of the machine in the report", "virtual")
        person.answers("Edges of the measured volume", "large")
        person.answers("expected three numbers", "300 200 100")
        person.answers("Class of the machine", "good")
        person.answers("Position feedback", "screw")
        person.answers("Pitch of the screws", "20")
        person.answers("Low corner of the volume", "")
        person.answers("Increments per axis", "2")
        person.answers("chain from workpiece", "")
        person.answers("Compensation of the machine", "off")
        assert person.leaves() == 0, person.seen
        assert "recognised instrument: umd" in person.seen
        assert "siemens-828d: S7" not in person.seen, "a port speaks one protocol"
        assert "stop_count" in person.seen
        survey = load_survey(file)
        assert (survey.plc.transport, survey.box.size_mm, survey.identity.name) == (
            "tcp",
            (300.0, 200.0, 100.0),
            "mill",
        )
        assert (survey.uncertainty.machine_class, survey.uncertainty.pitch_mm) == (
            "good",
            20.0,
        )
        assert "ordinary  a machining centre in a workshop" in person.seen
        code, out, said = stepdiag("check", file, "--seconds", "2")
        assert code == 0, out + said


@pytest.mark.parametrize(
    "named", [(), ("--control", "modbus")], ids=["unknown control", "named control"]
)
def test_a_control_that_does_not_answer_at_its_usual_port_is_asked_for_its_port(
    tmp_path, named
):
    """On a port of the builder's choice: nothing answers at 502, and the file would name a control
    that is not there. A wrong address is put right at the same question."""
    file, closed = tmp_path / "mill.toml", reserved_port()
    laser = ("--laser-port", "/dev/no-such-port", "--laser-format", "umd", "--seconds", 1)
    usual = (
        "--machine-class",
        "good",
        "--feedback",
        "scale",
        "--origin",
        "0,0,0",
        "--chain",
        "FXYZ",
        "--host",
        "control.invalid",
    )
    with (
        hall(tmp_path) as place,
        at_a_terminal("setup", file, *laser, *VOLUME, *usual, *named) as person,
    ):
        person.answers("Enter the TCP port", "99999")
        person.answers("expected a TCP port", "127.0.0.1")
        person.answers("Enter the TCP port", str(closed))
        person.answers("Enter the TCP port", str(modbus_port(place)))
        if not named:
            person.answers("Kind of control", "modbus")
        person.leaves()
        survey = load_survey(file)
    plc = survey.plc
    assert (plc.transport, plc.host, plc.tcp_port) == ("tcp", "127.0.0.1", modbus_port(place))


def test_options_alone_do_the_same_and_the_protocol_that_answers_is_taken(
    tmp_path, monkeypatch
):
    """Somebody who does not know what his control speaks: the first says why it is not the one.
    Nothing is overwritten."""
    gives_up_soon_on(monkeypatch, "modbus")
    file = tmp_path / "mill.toml"
    with hall(tmp_path) as place, s7_control(modbus_port(place)) as there:
        options = (
            "--laser-port",
            laser_port(place),
            "--laser-format",
            "umd",
            "--host",
            "127.0.0.1",
            "--port",
            there.port,
        )
        code, out, said = stepdiag("setup", file, *options, *VOLUME)
        assert code == 0, out + said
        survey = load_survey(file)
        assert (survey.plc.transport, survey.plc.tcp_port, survey.environment.source) == (
            "s7",
            there.port,
            "fixed",
        )
        assert re.search(r"modbus: .*expected", out)
        assert "heidenhain: " not in out, "a port speaks one protocol"
        written = file.read_bytes()
        done = stepdiag("setup", file, *options, *VOLUME)
        assert (done.code, file.read_bytes()) == (2, written)
        assert "found a file that already exists" in done.refusal
        code, out, said = stepdiag("check", file, "--seconds", "2")
        assert code == 0, out + said


def test_what_is_not_there_is_said_and_nothing_is_made_up(tmp_path):
    file = tmp_path / "mill.toml"
    closed = reserved_port()
    code, _, said = stepdiag(
        "setup",
        file,
        "--laser-port",
        f"socket://127.0.0.1:{closed}",
        "--host",
        "none",
        *VOLUME,
    )
    assert (code, file.exists()) == (4, False)
    assert "nothing listens on this port" in said
    done = stepdiag("setup", file, "--host", "none", *VOLUME)
    assert (done.code, file.exists()) == (2, False)
    assert "--laser-port" in done.refusal
    for wrong in (
        ("--size", "1,2"),
        ("--chain", "XYZ"),
        ("--increments", "0"),
        ("--control", "fanuc"),
        ("--compensation", "on"),
    ):
        done = stepdiag(
            "setup",
            file,
            "--laser-port",
            "/dev/x",
            "--laser-format",
            "umd",
            "--host",
            "none",
            *VOLUME,
            *wrong,
        )
        assert (done.code, file.exists()) == (2, False), done
    absent = (
        "--laser-port",
        "/dev/no-such-port",
        "--laser-format",
        "umd",
        "--host",
        "none",
        "--seconds",
        1,
    )
    stated = ("--baud", 57600, "--feedback", "screw", "--pitch-mm", 25)
    code, out, _ = stepdiag("setup", file, *absent, *VOLUME, *stated)
    assert code == 4
    survey = load_survey(file)
    assert (survey.plc.silent, survey.environment.source) == (True, "fixed"), (
        "the answers are kept, and what is missing is said"
    )
    assert (survey.laser.baud, survey.uncertainty.pitch_mm) == (57600, 25.0)
    assert "ERROR" in out


ANSWERS = {
    "Port of the laser": "/dev/no-such-port",
    "Format of the laser": "umd",
    "Name or address of the control": "none",
    "Name of the machine in the report": "mill",
    "Edges of the measured volume": "300 200 100",
    "Class of the machine": "poor",
    "Position feedback": "scale",
    "Low corner of the volume": "0 0 0",
    "Increments per axis": "2",
    "chain from workpiece": "FXYZ",
    "Compensation of the machine": "off",
}


@pytest.fixture
def asked(monkeypatch):
    """Answer at a terminal that is none, up to a question at which the person leaves; return what
    was asked."""
    questions = []

    async def heard_nothing(*_):
        return Heard("", 0, b"")

    def answer(question, *, default=None):
        questions.append(question)
        if len(questions) > leaves_at[0]:
            raise click.Abort
        return next(said for words, said in ANSWERS.items() if words in question)

    leaves_at = [len(ANSWERS)]
    monkeypatch.setattr("stepdiag.checking.hearing.listen", heard_nothing)
    monkeypatch.setattr("stepdiag.checking.hearing.ports", list)
    monkeypatch.setattr("typer.prompt", answer)
    monkeypatch.setattr(
        "sys.stdin", type("Terminal", (io.StringIO,), {"isatty": lambda self: True})()
    )
    return questions, leaves_at


@pytest.mark.parametrize("place", range(len(ANSWERS)))
def test_who_leaves_at_a_question_leaves_nothing_half_written(tmp_path, asked, place):
    questions, leaves_at = asked
    leaves_at[0] = place
    with pytest.raises(UsageError, match="no file was written"):
        setup(tmp_path / "mill.toml")
    assert len(questions) == place + 1
    assert [*ANSWERS][place] in questions[place]
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("while_it", ["listening on", "Port of the laser"])
def test_ctrl_c_ends_it_without_a_traceback_and_without_a_file(tmp_path, while_it):
    """While it listens to a line that says nothing, and at a question."""
    near, far = pty.openpty()
    try:
        port = (
            ()
            if while_it != "listening on"
            else ("--laser-port", os.ttyname(far), "--seconds", "60")
        )
        with at_a_terminal("setup", tmp_path / "mill.toml", *port) as person:
            person.leaves_it(while_it)
            assert person.leaves() != 0
            assert "Traceback" not in person.seen
    finally:
        os.close(near)
        os.close(far)
    assert [*tmp_path.iterdir()] == []


def test_a_tnc_is_found_by_its_protocol_among_the_three(tmp_path, monkeypatch):
    """The other two say why they are not the ones."""
    gives_up_soon_on(monkeypatch, "modbus", "siemens-828d")
    file = tmp_path / "mill.toml"
    with hall(tmp_path) as place, tnc_control(modbus_port(place)) as there:
        options = (
            "--laser-port",
            laser_port(place),
            "--laser-format",
            "umd",
            "--host",
            "127.0.0.1",
            "--port",
            there.port,
        )
        code, out, said = stepdiag("setup", file, *options, *VOLUME)
    assert code == 0, out + said
    assert load_survey(file).plc.transport == "lsv2"
    assert re.search(r"modbus: .*expected", out)
    assert re.search(r"siemens-828d: .*expected", out)
    assert re.search(r"heidenhain: .*setup 0", out)
