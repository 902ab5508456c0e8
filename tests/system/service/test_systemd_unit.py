"""The unit as systemd itself judges it, without booting one."""

import subprocess
import sys
from pathlib import Path

import pytest

from stepdiag.daemon.installation import drop_in
from stepdiag.daemon.publication import Publication
from stepdiag.daemon.publication import drop_in as published
from stepdiag.daq.survey.file import parse_survey

pytestmark = pytest.mark.system

SURVEY = """
[survey]
name = "mill"
machine = "M1"
[volume]
size_mm = [300.0, 200.0, 100.0]
increments = 2
[laser]
format = "umd"
port = "/dev/ttyUSB0"
[plc]
host = "192.168.5.2"
"""
UNIT = Path(__file__).parents[3] / "systemd" / "stepdiag@.service"
PUBLISH = UNIT.with_name("stepdiag-publish@.service")


def analyze(*arguments):
    """Run systemd-analyze; return (exit code, standard output, standard error)."""
    done = subprocess.run(["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_exposure_is_at_most_one_point_two():
    code, said, _ = analyze("security", "--offline=true", "--threshold=12", UNIT)
    assert code == 0, said.splitlines()[-1]


@pytest.mark.parametrize("host", ["192.168.5.2", "plc.hall.example"])
def test_so_it_is_with_a_plc_on_the_network(tmp_path, host):
    """With what `service install` opens for it: an address, or private networks for a name. Lines that come later count like a drop-in."""
    survey = parse_survey(SURVEY.replace("192.168.5.2", host), "mill.toml")
    opened = drop_in(survey, Path("/etc/stepdiag")).partition("[Service]")[2]
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("[Install]", f"[Service]{opened}[Install]"))
    code, said, _ = analyze("security", "--offline=true", "--threshold=12", unit)
    assert code == 0, said.splitlines()[-1]


@pytest.mark.parametrize(
    "publication",
    [Publication(broker="broker.works", port=8883), Publication(opcua="0.0.0.0", port=4840, plain=True)],
    ids=["broker", "opcua"],
)
def test_so_it_is_of_what_publishes(tmp_path, publication):
    opened = published("mill", tmp_path, publication).partition("[Service]")[2]
    unit = tmp_path / PUBLISH.name
    unit.write_text(PUBLISH.read_text().replace("[Install]", f"[Service]{opened}[Install]"))
    code, said, _ = analyze("security", "--offline=true", "--threshold=12", unit)
    assert code == 0, said.splitlines()[-1]


def test_systemd_finds_nothing_wrong(tmp_path):
    """``verify`` returns 0 even for a misspelt key: nothing may stand on standard error. The command is the one installed here."""
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/stepdiag/", f"{sys.prefix}/"))
    assert analyze("verify", unit) == (0, "", "")


def test_a_misspelt_key_is_seen(tmp_path):
    """The test above can fail."""
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/stepdiag/", f"{sys.prefix}/").replace("WatchdogSec", "WatchDogSec"))
    assert "WatchDogSec" in analyze("verify", unit)[2]
