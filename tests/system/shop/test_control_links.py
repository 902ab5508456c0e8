"""Controls in their own protocol: Siemens S7 (the library's server), Heidenhain LSV2 (a server from
the public description)."""

import asyncio
import json
import math
import os
import re
import signal
import socket
import threading
from contextlib import ExitStack, contextmanager

import pytest
from snap7.type import SrvArea

from stepdiag.checking.check import Observation, watch
from stepdiag.checking.diagnosis import diagnose
from stepdiag.daq.links.controls import lsv2, s7
from stepdiag.daq.links.controls.s7 import S7Settings
from stepdiag.daq.links.controls.s7 import open_link as open_s7
from stepdiag.daq.records.events import ReadRange
from stepdiag.daq.survey.controls import control_section
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.base.reserved import reserved_port
from testkit.cli import stepdiag
from testkit.running.controls import s7_control, telegram, tnc_control
from testkit.running.hall import daemon, hall, until
from testkit.running.survey_files import SMALLEST
from testkit.running.survey_runs import drive_and_replay
from testkit.running.verdict import nothing_silently_wrong

pytestmark = pytest.mark.system

ALL = ("modbus", "siemens-828d", "heidenhain")
CONTROLS = {"siemens-828d": s7_control, "heidenhain": tnc_control}
HANDSHAKE = {"siemens-828d": {"handshake": True, "dwell": 0.5}, "heidenhain": {}}


def with_control(text, name, port, *, timeout_s=10.0):
    """Return a survey file's text with the machine reached as the shipped section of this control
    says."""
    section = control_section(name, "127.0.0.1").replace(
        "timeout_s = 1.0", f"timeout_s = {timeout_s}\nport = {port}\npoll_hz = 100.0"
    )
    section = section.replace(
        "enabled = false",
        "enabled = true"
        if "enabled = true" in text.split("[plc.handshake]")[1]
        else "enabled = false",
    )
    before, after = text.split("[plc]\n")
    return f"{before}[plc]\n{section}\n[stop]{after.split('[stop]')[1]}"


@contextmanager
def controlled(folder, name, **options):
    """A hall whose machine is reached through a control of this name."""
    with hall(
        folder, laser_survey='[environment]\nsource = "fixed"\n', **HANDSHAKE[name], **options
    ) as place:
        text = place.survey.read_text()
        modbus = int(re.search(r"\[plc\]\nport = (\d+)", text)[1])
        with CONTROLS[name](modbus) as control:
            place.survey.write_text(with_control(text, name, control.port))
            yield place, control


def start_the_next(place):
    """Start the next setup once the machine waits for it."""
    while place.bench.next(60.0, "bench")["event"] != "waiting":
        pass
    place.bench.say("start")


@pytest.mark.parametrize("name", CONTROLS)
def test_a_survey_is_recorded_through_a_lost_control_and_a_killed_daemon_and_replayed(
    tmp_path, name
):
    """Checked first as a person would; after the first setup the control's network goes and comes
    back, then the daemon is killed."""
    with controlled(tmp_path, name, n=1) as (place, control):
        code, out, said = stepdiag("check", place.survey, "--seconds", "2", "--json")
        assert code == 0, said
        assert json.loads(out)["machine"]["signals"]["setup"] == 0
        with daemon(place.survey) as process:
            start_the_next(place)
            until(process, "pass-ended")
            control.stop()
            until(process, "link-lost", link="machine")
            control.start()
            until(process, "link-connected", link="machine")
            os.kill(process.process.pid, signal.SIGKILL)
            process.process.wait()
        drive_and_replay(place)
        nothing_silently_wrong(place)


@contextmanager
def listener(answer):
    """A port on which something else listens: ``answer`` takes a connection."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.1)
        ended = threading.Event()

        def serve():
            while not ended.is_set():
                try:
                    connection, _ = server.accept()
                except TimeoutError:
                    continue
                with connection:
                    answer(connection, ended)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            ended.set()
            thread.join()


def web_server(connection, ended):
    connection.recv(100)
    connection.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")


def drips(connection, ended):
    """Half an answer for ever: the length of a long one, then a byte now and then."""
    connection.recv(100)
    try:
        connection.sendall(b"\x03\x00\xff\x00")
        while not ended.wait(0.05):
            connection.sendall(b"\xd0")
    except OSError:
        pass


def refuses_the_slot(connection, ended):
    connection.recv(100)
    connection.sendall(bytes.fromhex("0300000b06800000000100"))


def hangs_up(connection, ended):
    connection.recv(100)


OTHERS = {
    ("siemens-828d", web_server): "bytes of another protocol",
    ("siemens-828d", refuses_the_slot): "check plc.rack and plc.slot",
    ("siemens-828d", hangs_up): "check plc.rack and plc.slot",
    ("heidenhain", web_server): "another protocol",
    ("heidenhain", hangs_up): "Connection reset by peer",
}


def looked_at(name, port, changed=lambda text: text, *, host="127.0.0.1"):
    """Watch a machine as `check` does until something is to be said of it, without any laser;
    return it and the findings by code."""
    section = f"{re.sub(r'(?m)^timeout_s = .*$', '', control_section(name, host))}\n"
    section = section.replace(
        f'host = "{host}"', f'host = "{host}"\ntimeout_s = 1.0\nport = {port}'
    )
    survey = parse_survey(changed(f"{SMALLEST}[plc]\n{section}"), "s")
    seen = Observation(survey)

    def until_something_is_said():
        if seen.machine.polls or seen.machine.link.state in ("lost", "silent"):
            seen.seconds = math.inf

    asyncio.run(watch(seen, 60.0, until_something_is_said))
    return seen, {name: each for each in diagnose(seen) for name in (each.code, each.key)}


@pytest.mark.parametrize(
    ("name", "other"), OTHERS, ids=lambda each: getattr(each, "__name__", each)
)
def test_another_product_or_another_slot_is_named(name, other):
    with listener(other) as port:
        _, found = looked_at(name, port)
    assert OTHERS[name, other] in found["machine-unreachable"].text


@pytest.fixture
def hurried(monkeypatch):
    """How long is waited for a connection is not what is shown. (Of S7 it is the library's own five
    seconds.)"""
    monkeypatch.setattr(lsv2, "CONNECT_S", 1.0)


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("name", CONTROLS)
def test_half_an_answer_for_ever_is_named(name, monkeypatch):
    monkeypatch.setattr(s7, "CONNECT_S", 1.0)
    with listener(drips) as port:
        _, found = looked_at(name, port)
    assert (
        "silence" in found["machine-unreachable"].text
        or "another protocol" in found["machine-unreachable"].text
    )


@contextmanager
def swallowing():
    """A port whose connections are neither taken nor refused, as behind a firewall: its queue is
    full, the kernel drops what asks."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server, ExitStack() as asking:
        for _ in range(4):
            one = asking.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(server.getsockname())
        yield server.getsockname()[1]


def says_nothing(connection, ended):
    ended.wait(60.0)


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("name", ALL)
def test_a_connection_that_a_firewall_swallows_is_named(name):
    with swallowing() as port:
        _, found = looked_at(name, port)
    assert "neither an answer nor a refusal" in found["machine-unreachable"].text
    assert "firewall" in found["machine-unreachable"].text


@pytest.mark.parametrize("name", ALL)
def test_a_host_that_nobody_knows_is_named(name):
    _, found = looked_at(name, 1, host="no-such-control.invalid")
    assert "no such name; check plc.host" in found["machine-unreachable"].text


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("name", ALL)
def test_a_port_that_takes_a_connection_and_says_nothing_is_named(name):
    with listener(says_nothing) as port:
        _, found = looked_at(name, port)
    (code,) = [code for code in found if code.startswith("machine-")]
    assert "silence" in found[code].text


@pytest.mark.parametrize("name", ALL)
def test_a_closed_port_is_named(name):
    port = reserved_port()
    _, found = looked_at(name, port)
    assert "nothing listens on this port" in found["machine-unreachable"].text


def test_a_control_that_wants_a_password_is_named():
    with tnc_control(password="secret") as control:
        _, found = looked_at("heidenhain", control.port)
    assert "requires a password" in found["machine-unreachable"].text


def test_a_data_block_that_is_not_there_is_named_and_the_others_are_read():
    """Without the axes nobody knows whether the machine stands: that is an error, not a machine
    that never stands."""
    with s7_control() as control:
        seen, found = looked_at(
            "siemens-828d", control.port, lambda text: text.replace('"db3902"', '"db3912"')
        )
    assert found["signals-absent.refused"].severity == "error"
    assert "fine_z at db3912 0 bit 7" in found["signals-absent.refused"].text
    assert "object does not exist" in found["signals-absent.refused"].text
    assert seen.machine.signals.setup == 0


def test_answers_that_are_no_memory_are_named():
    """A TNC whose memory telegrams are shorter than asked for: never a number."""

    def short(letters, data):
        return telegram("S_MB", b"\0") if letters == "R_MB" else None

    with tnc_control(answer=short) as control:
        seen, found = looked_at("heidenhain", control.port)
    assert "another protocol" in found["machine-unreachable"].text
    assert seen.machine.polls == 0


@contextmanager
def nowhere():
    yield 1


SAID = {
    "another product": (
        lambda: listener(web_server),
        "127.0.0.1",
        "bytes of another protocol",
    ),
    "wrong name": (nowhere, "no-such-control.invalid", "no such name"),
    "wrong slot": (
        lambda: listener(refuses_the_slot),
        "127.0.0.1",
        "check plc.rack and plc.slot",
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_the_journal_names_it_too(tmp_path, case):
    place_of, host, words = SAID[case]
    with (
        hall(tmp_path, laser_survey='[environment]\nsource = "fixed"\n') as place,
        place_of() as port,
    ):
        place.survey.write_text(
            with_control(place.survey.read_text(), "siemens-828d", port).replace(
                'host = "127.0.0.1"', f'host = "{host}"'
            )
        )
        with daemon(place.survey, wait_for=("laser",)) as process:
            assert words in until(process, "link-lost", link="machine")[-1]["detail"]


def test_a_password_is_named_in_the_journal(tmp_path):
    with (
        hall(tmp_path, laser_survey='[environment]\nsource = "fixed"\n') as place,
        tnc_control(password="secret") as control,
    ):
        place.survey.write_text(
            with_control(place.survey.read_text(), "heidenhain", control.port)
        )
        with daemon(place.survey, wait_for=("laser",)) as process:
            assert (
                "requires a password"
                in until(process, "link-lost", link="machine")[-1]["detail"]
            )


async def polled(control, settings, wanted, times):
    """Read so often over one connection; return the blocks, and how many telegrams each took."""
    link = await open_s7(settings, wanted)
    blocks, asked = [], []
    for _ in range(times):
        before = control.telegrams
        blocks.append(await link.read())
        asked.append(control.telegrams - before)
        assert [each.table for each in link.refusals] == ["db3902"]
    link.close()
    return blocks, asked


def test_an_s7_that_refuses_one_block_is_asked_for_the_others_in_one_telegram():
    """What tells of one moment stays of one moment."""
    with s7_control() as control:
        control.server.unregister_area(SrvArea.DB, 3902)
        wanted = [
            ReadRange("db4900", 0, 6),
            *(ReadRange(f"db390{axis}", 0, 2) for axis in range(3)),
        ]
        settings = S7Settings(host="127.0.0.1", port=control.port, timeout_s=10.0)
        polls, asked = asyncio.run(polled(control, settings, wanted, 4))
    assert [[len(data) for data in block.data] for block in polls] == [[6, 2, 2, 0]] * 4
    assert asked[0] > 1, "each alone, to find out"
    assert asked[1:] == [1, 1, 1]
