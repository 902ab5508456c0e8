"""The unit under a real systemd: the installed wheel, a survey, a killed, a hanging and a stopped
daemon."""

import json
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from stepdiag.daemon.installation import drop_ins
from stepdiag.daq.survey.file import parse_survey
from stepdiag.virtual.base.reserved import reserved_port
from testkit.running.boot import (
    as_root,
    booted,
    debian_root,
    forget_surveys,
    install_units,
    install_wheel,
    write,
)
from testkit.running.hall import hall

pytestmark = pytest.mark.system

UNIT = "stepdiag@hall.service"
PAGE, PUBLISHER = "stepdiag-page@hall.service", "stepdiag-publish@hall.service"
ATTACK = Path(__file__).parents[2] / "lib/testkit/hostile/attack.py"
RECORDED = "/var/lib/stepdiag/hall"
DIALOUT = 20
"""The group of serial lines on every Debian."""
DROP_IN = (
    "[Service]\nDeviceAllow=char-pts "
    "rw\nBindReadOnlyPaths=/opt/libraries\nWatchdogSec=3\nRestartSec=1\n"
)
"""A pty stands for the serial line, a mount for installed libraries; the rest only makes the test
shorter."""


def stops(system):
    """Return (setup, stop) of every stop captured so far."""
    return [
        (said["setup"], said["stop"])
        for said in system.journal(UNIT)
        if said["event"] == "stop"
    ]


def wait_for_stop(system, more_than):
    """Return how many stops there are, once there are more."""
    end = time.monotonic() + 30
    while (count := len(stops(system))) <= more_than:
        assert time.monotonic() < end, system.journal(UNIT)[-5:]
        time.sleep(0.2)
    return count


def active_again(system, before):
    """Return the unit's properties once another process than before is ready."""
    return system.until(
        UNIT,
        lambda unit: (
            unit["ActiveState"] == "active"
            and unit["MainPID"] not in ("0", before["MainPID"])
        ),
    )


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The root file system with the wheel in it, installed once; no test writes to the program."""
    root = debian_root()
    install_wheel(root, tmp_path_factory.mktemp("wheel"))
    return root


def install(root, place):
    """Install units and survey beside the wheel; return the laser's line as the container is to see
    it."""
    forget_surveys(root)
    install_units(root, "hall", DROP_IN)
    laser = place.folder / "devices" / "laser"
    survey = place.survey.read_text().replace(
        'name = "hall"', 'name = "hall"\ndirectory = "/var/lib/stepdiag"'
    )
    write(root / "etc/stepdiag/hall.toml", survey.replace(str(laser), "/dev/ttyUSB0"))
    line = laser.resolve()
    as_root("chgrp", DIALOUT, line)
    as_root("chmod", "660", line)
    return f"{line}:/dev/ttyUSB0"


@pytest.mark.timeout(600)
def test_a_survey_goes_on_after_a_kill_a_hang_and_a_stop(installed, tmp_path):
    """With the handshake the machine waits at a stop while the daemon is away: nothing is missing
    in the end."""
    with hall(tmp_path, handshake=True, n=2) as place:
        line = install(installed, place)
        with booted(installed, "stepdiag-test", line) as system:
            unit = system.until(
                UNIT,
                lambda unit: (
                    unit["ActiveState"] == "active"
                    and "waiting for the program" in unit.get("StatusText", "")
                ),
            )
            assert_confined(unit["MainPID"], system)
            place.start_setups(stop_after=1)
            count = wait_for_stop(system, 1)

            system.run("kill", "-KILL", unit["MainPID"])
            unit = active_again(system, unit)
            count = wait_for_stop(system, count)

            system.run("kill", "-STOP", unit["MainPID"])
            unit = active_again(system, unit)
            assert system.show(UNIT)["NRestarts"] == "2"
            wait_for_stop(system, count)

            system.run("systemctl", "stop", UNIT)
            stopped = system.show(UNIT)
            assert (stopped["ActiveState"], stopped["Result"], stopped["ExecMainStatus"]) == (
                "inactive",
                "success",
                "0",
            )

            system.run("systemctl", "start", UNIT)
            place.setups = place.setups[1:]
            place.start_setups()
            # the stops about the kill wait for a person's word: nothing is exported by itself
            system.until(
                UNIT, lambda unit: "for a person to accept" in unit.get("StatusText", "")
            )
            # which stops is said once the readings are written
            system.until(
                UNIT,
                lambda _: any(
                    said["event"] == "survey-open" for said in system.journal(UNIT)
                ),
            )
            assert not [
                said for said in system.journal(UNIT) if said["event"] == "survey-complete"
            ]
            for doubted in [
                said["doubted"]
                for said in system.journal(UNIT)
                if said["event"] == "survey-open"
            ][-1]:
                accept = (
                    "/opt/stepdiag/bin/stepdiag",
                    "accept",
                    RECORDED,
                    doubted,
                    "--reason",
                    "the beam was free all the while",
                )
                system.run(*accept)
            system.until(
                UNIT,
                lambda _: any(
                    said["event"] == "survey-complete" for said in system.journal(UNIT)
                ),
            )
            assert [
                said["exit_code"]
                for said in system.journal(UNIT)
                if said["event"] == "survey-complete"
            ] == [0]
            assert_replays(system, tmp_path)


HARMLESS = {
    "reads the log",
    "reads /etc/passwd",
    "a unix socket",
    "fork",
    "spawn",
    "exec",
    "a process by clone3",
    "io_uring",
    "kill 0",
    "a signal to all",
}
"""What the page's unit leaves open before the page sets up its own walls: nothing of it reaches
another account, a file or the network. A signal to all reaches those of its own account."""


OF_A_PUBLISHER = HARMLESS | {
    "TCP to the PLC",
    "UDP to the PLC",
    "TCP in one packet",
    "a listening port",
}
"""The same, and sockets to the addresses of its drop-in, to which the virtual PLC of this test
belongs; a booted container has no programs of BPF, so that SocketBindDeny= does nothing in it. The
walls of the process shut these, too (`test_walls`)."""


@pytest.mark.timeout(600)
def test_page_has_an_account_of_its_own_and_reaches_nothing(installed, tmp_path):
    """A visitor starts it; it shows what the recorder says over a socket. An attacker in its unit,
    and then one in that of what publishes, changes nothing of the one survey that runs meanwhile:
    every stop is captured.
    """
    port = reserved_port()
    with hall(tmp_path, n=2, page=True, page_port=port) as place:
        root, line = installed, install(installed, place)
        survey = parse_survey((root / "etc/stepdiag/hall.toml").read_text(), "hall.toml")
        for path, text in drop_ins("hall", survey, Path("/etc/stepdiag")).items():
            write(root / path, text)
        write(root / "opt/stepdiag/attack.py", ATTACK.read_text())
        command = (
            "/opt/stepdiag/bin/python /opt/stepdiag/attack.py unit 99 %d "
            f"{place.ready['plc_port']} {RECORDED}/0001 /etc/shadow"
        )
        as_root(
            "systemctl", "--quiet", f"--root={root}", "enable", "stepdiag-page@hall.socket"
        )
        with booted(root, "stepdiag-page-test", line) as system:
            recorder = system.until(UNIT, lambda unit: unit["ActiveState"] == "active")
            place.start_setups(stop_after=1)
            wait_for_stop(system, 1)
            attack = f"[Service]\nExecStartPre={command % int(recorder['MainPID'])}\n"
            own = reserved_port()
            served = (
                f'Environment="PUBLISH=--opcua 127.0.0.1:{own} '
                f'--plain"\nSocketBindAllow=tcp:{own}\n'
            )
            for unit, text in ((PAGE, attack), (PUBLISHER, attack + served)):
                folder = f"/run/systemd/system/{unit}.d"
                system.run(
                    "sh",
                    "-c",
                    'mkdir -p "$0" && printf %s "$1" > "$0/attack.conf"',
                    folder,
                    text,
                )
            system.run("systemctl", "daemon-reload")
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=60) as answer:
                assert answer.status == 200
            page = system.show(PAGE)
            accounts = [
                system.run("stat", "-c", "%U", f"/proc/{each['MainPID']}").strip()
                for each in (recorder, page)
            ]
            assert accounts == ["stepdiag", "stepdiag-page"]
            (found,) = [said for said in system.journal(PAGE) if "succeeded" in said]
            assert found["tried"] >= 50
            assert set(found["succeeded"]) <= HARMLESS
            confined = [
                said for said in system.journal(UNIT) if said["event"] == "page-confined"
            ]
            # systemd-nspawn refuses Landlock's calls to what it boots, up to version 254: what is
            # open then is named
            assert [
                said["open"] in ("nothing", "reading the disk and the memory of its account")
                for said in confined
            ] == [True]
            stranger = (
                "import socket; s = socket.socket(socket.AF_UNIX); "
                "s.connect('/var/lib/private/stepdiag/.hall.page'); print(s.recv(1))"
            )
            system.run("python3", "-c", stranger)
            assert [
                said["account"]
                for said in system.journal(UNIT)
                if said["event"] == "page-stranger"
            ] == [0]
            count = wait_for_stop(system, 0)
            place.start_setups()
            wait_for_stop(system, count)
            system.run("systemctl", "start", PUBLISHER)
            system.until(
                PUBLISHER,
                lambda _: any(
                    said.get("event") == "opcua-serves" for said in system.journal(PUBLISHER)
                ),
            )
            (found,) = [said for said in system.journal(PUBLISHER) if "succeeded" in said]
            assert found["tried"] >= 50
            assert set(found["succeeded"]) <= OF_A_PUBLISHER
            system.until(
                UNIT,
                lambda _: any(
                    said["event"] == "survey-complete" for said in system.journal(UNIT)
                ),
            )
            assert len(stops(system)) == 4 * 7


def assert_confined(pid, system):
    """The process is nobody's, may gain no rights, its calls are filtered (proc(5)), and of the
    disk it sees what it needs."""
    status = dict(
        line.split(":\t", 1)
        for line in system.run("cat", f"/proc/{pid}/status").splitlines()
        if ":\t" in line
    )
    assert status["Uid"].split()[0] != "0"
    assert (status["NoNewPrivs"], status["Seccomp"], status["CapEff"]) == ("1", "2", "0" * 16)
    seen = set(system.run("ls", f"/proc/{pid}/root").split())
    assert {"usr", "etc", "opt", "var"} <= seen
    assert not seen & {"boot", "media", "mnt", "srv"}, seen


def assert_replays(system, folder):
    """What the service left in its state folder gives the same bytes again, outside."""
    recorded = folder / "recorded"
    as_root(
        "cp",
        "-r",
        "--no-preserve=ownership,mode",
        Path(system.root) / "var/lib/private/stepdiag/hall/0001",
        recorded,
    )
    as_root("chmod", "-R", "a+rX", recorded)
    command = [
        sys.executable,
        "-m",
        "stepdiag",
        "replay",
        recorded,
        "--out",
        folder / "again",
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["different"] == []
