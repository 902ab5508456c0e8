"""The unit under a real systemd: the installed wheel, a survey, a killed, a hanging and a stopped daemon."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from testkit.running.boot import as_root, booted, debian_root, install_units, install_wheel, write
from testkit.running.hall import hall

pytestmark = pytest.mark.system

UNIT = "stepdiag@hall.service"
RECORDED = "/var/lib/stepdiag/hall"
DIALOUT = 20
"""The group of serial lines on every Debian."""
DROP_IN = "[Service]\nDeviceAllow=char-pts rw\nBindReadOnlyPaths=/opt/libraries\nWatchdogSec=3\nRestartSec=1\n"
"""A pty stands for the serial line, a mount for installed libraries; the rest only makes the test shorter."""


def stops(system):
    """Return (setup, stop) of every stop captured so far."""
    return [(said["setup"], said["stop"]) for said in system.journal(UNIT) if said["event"] == "stop"]


def wait_for_stop(system, more_than):
    """Return how many stops there are, once there are more."""
    end = time.monotonic() + 30
    while (count := len(stops(system))) <= more_than:
        assert time.monotonic() < end, system.journal(UNIT)[-5:]
        time.sleep(0.2)
    return count


def active_again(system, before):
    """Return the unit's properties once another process than before is ready."""
    return system.until(UNIT, lambda unit: unit["ActiveState"] == "active" and unit["MainPID"] not in ("0", before["MainPID"]))


def install(place):
    """Install wheel, units and survey; return the root and the laser's line as the container is to see it."""
    root = debian_root()
    install_wheel(root, place.folder)
    install_units(root, "hall", DROP_IN)
    laser = place.folder / "devices" / "laser"
    survey = place.survey.read_text().replace('name = "hall"', 'name = "hall"\ndirectory = "/var/lib/stepdiag"')
    write(root / "etc/stepdiag/hall.toml", survey.replace(str(laser), "/dev/ttyUSB0"))
    line = laser.resolve()
    as_root("chgrp", DIALOUT, line)
    as_root("chmod", "660", line)
    return root, f"{line}:/dev/ttyUSB0"


@pytest.mark.timeout(600)
def test_a_survey_goes_on_after_a_kill_a_hang_and_a_stop(tmp_path):
    """With the handshake the machine waits at a stop while the daemon is away: nothing is missing in the end."""
    with hall(tmp_path, handshake=True, n=2) as place:
        root, line = install(place)
        with booted(root, "stepdiag-test", line) as system:
            unit = system.until(
                UNIT, lambda unit: unit["ActiveState"] == "active" and "waiting for the program" in unit.get("StatusText", "")
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
            assert (stopped["ActiveState"], stopped["Result"], stopped["ExecMainStatus"]) == ("inactive", "success", "0")

            system.run("systemctl", "start", UNIT)
            place.setups = place.setups[1:]
            place.start_setups()
            # the stops about the kill wait for a person's word: nothing is exported by itself
            system.until(UNIT, lambda unit: "somebody who accepts it" in unit.get("StatusText", ""))
            # which stops is said once the readings are written
            system.until(UNIT, lambda _: any(said["event"] == "survey-open" for said in system.journal(UNIT)))
            assert not [said for said in system.journal(UNIT) if said["event"] == "survey-complete"]
            for doubted in [said["doubted"] for said in system.journal(UNIT) if said["event"] == "survey-open"][-1]:
                accept = ("/opt/stepdiag/bin/stepdiag", "accept", RECORDED, doubted, "--reason", "the beam was free all the while")
                system.run(*accept)
            system.until(UNIT, lambda _: any(said["event"] == "survey-complete" for said in system.journal(UNIT)))
            assert [said["exit_code"] for said in system.journal(UNIT) if said["event"] == "survey-complete"] == [0]
            assert_replays(system, tmp_path)


def assert_confined(pid, system):
    """The process is nobody's, may gain no rights, its calls are filtered (proc(5)), and of the disk it sees what it needs."""
    status = dict(line.split(":\t", 1) for line in system.run("cat", f"/proc/{pid}/status").splitlines() if ":\t" in line)
    assert status["Uid"].split()[0] != "0"
    assert (status["NoNewPrivs"], status["Seccomp"], status["CapEff"]) == ("1", "2", "0" * 16)
    seen = set(system.run("ls", f"/proc/{pid}/root").split())
    assert {"usr", "etc", "opt", "var"} <= seen
    assert not seen & {"boot", "media", "mnt", "srv"}, seen


def assert_replays(system, folder):
    """What the service left in its state folder gives the same bytes again, outside."""
    recorded = folder / "recorded"
    as_root("cp", "-r", "--no-preserve=ownership,mode", Path(system.root) / "var/lib/private/stepdiag/hall/0001", recorded)
    as_root("chmod", "-R", "a+rX", recorded)
    command = [sys.executable, "-m", "stepdiag", "replay", recorded, "--out", folder / "again", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["different"] == []
