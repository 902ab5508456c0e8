"""The unit as systemd itself judges it, without booting one."""

import subprocess
import sys
from pathlib import Path

import pytest

from stepdiag.daemon.installation import drop_ins
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
PAGE, PUBLISH = (
    UNIT.with_name("stepdiag-page@.service"),
    UNIT.with_name("stepdiag-publish@.service"),
)
EXPOSURE = {UNIT: 14, PAGE: 3, PUBLISH: 12}
"""Tenths, by `systemd-analyze security`. The recorder has no user namespace: in one the account of
who calls it is unknown."""


def analyze(*arguments):
    """Run systemd-analyze; return (exit code, standard output, standard error)."""
    done = subprocess.run(
        ["systemd-analyze", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("unit", EXPOSURE, ids=lambda unit: unit.name)
def test_the_exposure_of_each_unit(unit):
    code, said, _ = analyze(
        "security", "--offline=true", f"--threshold={EXPOSURE[unit]}", unit
    )
    assert code == 0, said.splitlines()[-1]


@pytest.mark.parametrize("unit", [UNIT, PAGE], ids=lambda unit: unit.name)
@pytest.mark.parametrize("host", ["192.168.5.2", "plc.hall.example"])
def test_so_it_is_with_a_plc_and_a_page_on_the_network(tmp_path, host, unit):
    """With what `service install` opens: an address, or private networks for a name. Lines that
    come later count like a drop-in."""
    survey = parse_survey(
        SURVEY.replace("192.168.5.2", host)
        + '[page]\nhost = "0.0.0.0"\ntoken_file = "token"\n',
        "mill.toml",
    )
    opened = {
        place.parent.name: text
        for place, text in drop_ins("mill", survey, Path("/etc/stepdiag")).items()
    }
    lines = opened[f"{unit.stem}mill.service.d"].partition("[Service]")[2]
    with_drop_in = tmp_path / unit.name
    with_drop_in.write_text(f"{unit.read_text()}\n[Service]{lines}")
    code, said, _ = analyze(
        "security", "--offline=true", f"--threshold={EXPOSURE[unit]}", with_drop_in
    )
    assert code == 0, said.splitlines()[-1]
    assert "ListenStream=0.0.0.0:8420" in opened["stepdiag-page@mill.socket.d"]
    assert "ListenStream" not in lines
    assert "LoadCredential" not in opened["stepdiag@mill.service.d"], (
        "the recorder has no secret"
    )


@pytest.mark.parametrize(
    "publication",
    [
        Publication(broker="broker.works", port=8883),
        Publication(opcua="0.0.0.0", port=4840, plain=True),
    ],
    ids=["broker", "opcua"],
)
def test_so_it_is_of_what_publishes(tmp_path, publication):
    opened = published("mill", tmp_path, publication).partition("[Service]")[2]
    unit = tmp_path / PUBLISH.name
    unit.write_text(PUBLISH.read_text().replace("[Install]", f"[Service]{opened}[Install]"))
    code, said, _ = analyze("security", "--offline=true", "--threshold=12", unit)
    assert code == 0, said.splitlines()[-1]


def test_systemd_finds_nothing_wrong(tmp_path):
    """``verify`` returns 0 even for a misspelt key: nothing may stand on standard error. The
    command is the one installed here."""
    for unit in (UNIT, PAGE, PUBLISH, PAGE.with_suffix(".socket")):
        (tmp_path / unit.name).write_text(
            unit.read_text().replace("/opt/stepdiag/", f"{sys.prefix}/")
        )
    socket = tmp_path / "stepdiag-page@.socket"
    socket.write_text(
        socket.read_text().replace("Backlog", "ListenStream=127.0.0.1:8420\nBacklog")
    )
    assert analyze("verify", *tmp_path.iterdir()) == (0, "", "")


def test_a_misspelt_key_is_seen(tmp_path):
    """The test above can fail."""
    unit = tmp_path / UNIT.name
    unit.write_text(
        UNIT.read_text()
        .replace("/opt/stepdiag/", f"{sys.prefix}/")
        .replace("WatchdogSec", "WatchDogSec")
    )
    assert "WatchDogSec" in analyze("verify", unit)[2]
