"""A survey as a service: what is written, what is left alone, what is taken away again."""

import subprocess
from pathlib import Path

import pytest

from testkit import installing
from testkit.cli import stepdiag
from testkit.installing import root_with, service, written

SURVEY = (
    installing.SURVEY.replace('directory = "/var/lib/stepdiag"\n', "")
    + """[page]
token_file = "mill.token"
port = 8500
"""
)
DROP_IN = "etc/systemd/system/stepdiag@mill.service.d/50-survey.conf"
PAGE, SOCKET = (
    DROP_IN.replace("stepdiag@mill.service", f"stepdiag-page@mill.{kind}")
    for kind in ("service", "socket")
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return root_with(tmp_path, SURVEY)


def test_what_the_survey_needs_is_opened_and_nothing_else(root: Path) -> None:
    """The recorder: the PLC's address alone, no port and no secret. The page: its port alone, the
    token as a credential, no network."""
    service("install", root)
    lines = (root / DROP_IN).read_text().splitlines()
    assert [
        line.partition("=")[2] for line in lines if line.startswith("IPAddressAllow")
    ] == [
        "",
        "localhost",
        "192.168.4.20",
    ]
    assert len(lines) == 5, lines
    assert (root / PAGE).read_text().splitlines()[2:] == [
        "LoadCredential=page-token:/etc/stepdiag/mill.token"
    ]
    assert (root / SOCKET).read_text().splitlines()[2:] == [
        "ListenStream=",
        "ListenStream=127.0.0.1:8500",
    ]
    token = root / "etc/stepdiag/mill.token"
    assert token.stat().st_mode & 0o777 == 0o600
    assert len(token.read_text().strip()) >= 16
    assert set(written(root)) == {
        DROP_IN,
        PAGE,
        SOCKET,
        "etc/stepdiag/mill.toml",
        "etc/stepdiag/mill.token",
        "etc/systemd/system/stepdiag@.service",
        "etc/systemd/system/stepdiag-page@.service",
        "etc/systemd/system/stepdiag-page@.socket",
        "etc/sysusers.d/stepdiag.conf",
        "etc/udev/rules.d/90-stepdiag.rules",
        "etc/modules-load.d/stepdiag.conf",
    }


def test_installing_again_changes_nothing(root: Path) -> None:
    """Not even a time, and not the token; a survey that has changed changes its drop-in alone."""
    service("install", root)
    before = written(root)
    assert "write" not in service("install", root)
    assert written(root) == before
    survey = root / "etc/stepdiag/mill.toml"
    survey.write_text(SURVEY.replace("192.168.4.20", "10.0.0.9"), encoding="utf-8")
    service("install", root)
    assert {name for name, told in written(root).items() if told != before[name]} == {
        DROP_IN,
        "etc/stepdiag/mill.toml",
    }


def test_a_dry_run_shows_everything_and_writes_nothing(root: Path) -> None:
    """But no secret."""
    before = written(root)
    said = service("install", root, "--dry-run")
    assert written(root) == before
    assert "IPAddressAllow=192.168.4.20" in said
    assert f"make secret: {root}/etc/stepdiag/mill.token" in said


def test_removing_leaves_survey_token_and_the_others(root: Path) -> None:
    """What all surveys share goes with the last of them."""
    (root / "etc/stepdiag/lathe.toml").write_text(
        SURVEY.replace("mill.token", "lathe.token"), encoding="utf-8"
    )
    service("install", root)
    service("install", root, name="lathe")
    service("remove", root)
    assert not (root / DROP_IN).parent.exists()
    assert (root / "etc/systemd/system/stepdiag@.service").exists()
    service("remove", root, name="lathe")
    left = {
        "etc/stepdiag/mill.toml",
        "etc/stepdiag/mill.token",
        "etc/stepdiag/lathe.toml",
        "etc/stepdiag/lathe.token",
    }
    assert set(written(root)) == left
    assert "nothing to do" in service("remove", root)


@pytest.mark.parametrize(
    ("changed", "allowed"),
    [
        ('host = "192.168.4.20"\n', ["192.168.4.20"]),
        ('host = "fd00::7%eth0"\n', ["fd00::7"]),
        ('host = "127.0.0.1"\n', []),
        ('transport = "rtu"\nserial_port = "/dev/ttyUSB1"\npoll_hz = 10\n', []),
        (
            'host = "plc.example"\n',
            ["link-local", "10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "fc00::/7"],
        ),
    ],
)
def test_the_plc_alone_is_reached(root: Path, changed: str, allowed: list[str]) -> None:
    """A name can have any address: then private networks."""
    text = SURVEY.replace('host = "192.168.4.20"\n', changed)
    (root / "etc/stepdiag/mill.toml").write_text(text, encoding="utf-8")
    service("install", root)
    lines = (root / DROP_IN).read_text().splitlines()
    assert [
        line.partition("=")[2] for line in lines if line.startswith("IPAddressAllow")
    ] == [
        "",
        "localhost",
        *allowed,
    ]


@pytest.mark.parametrize(
    "changed", ['host = "fe80::1%a\\nExecStart=/bin/sh"', 'host = "a\\nExecStart=/bin/sh"']
)
def test_nothing_in_a_survey_becomes_a_line_of_the_unit(root: Path, changed: str) -> None:
    (root / "etc/stepdiag/mill.toml").write_text(
        SURVEY.replace('host = "192.168.4.20"', changed), encoding="utf-8"
    )
    service("install", root)
    assert "ExecStart" not in (root / DROP_IN).read_text()
    (root / "etc/stepdiag/mill.toml").write_text(
        SURVEY.replace('"mill.token"', '"m\\nExecStart=x"'), encoding="utf-8"
    )
    refused = stepdiag("service", "install", root / "etc/stepdiag/mill.toml", "--root", root)
    assert refused.code == 2
    assert "page-token" in refused.refusal


@pytest.mark.parametrize("host", ["hall.example", "0.0.0.0\\nExecStart=/bin/sh"])
def test_page_listens_on_an_address_alone(root: Path, host: str) -> None:
    (root / "etc/stepdiag/mill.toml").write_text(
        SURVEY.replace("port = 8500", f'port = 8500\nhost = "{host}"'), encoding="utf-8"
    )
    refused = stepdiag("service", "install", root / "etc/stepdiag/mill.toml", "--root", root)
    assert (refused.code, "page.host" in refused.refusal) == (2, True)


def test_survey_without_a_page_has_no_page_unit(root: Path) -> None:
    service("install", root)
    (root / "etc/stepdiag/mill.toml").write_text(
        SURVEY.replace("port = 8500", "enabled = false"), encoding="utf-8"
    )
    service("install", root)
    assert not {PAGE, SOCKET} & set(written(root))


def test_a_survey_elsewhere_is_refused_with_the_way(root: Path) -> None:
    (root / "mill.toml").write_text(SURVEY, encoding="utf-8")
    refused = stepdiag("service", "install", root / "mill.toml", "--root", root)
    assert refused.code == 2
    assert "copy the survey file to this folder" in refused.refusal


def test_systemd_finds_nothing_wrong_with_what_is_written(root: Path) -> None:
    """Units and drop-ins together."""
    service("install", root)
    units = root / "etc/systemd/system"
    done = subprocess.run(
        [
            "systemd-analyze",
            "verify",
            *(
                f"stepdiag{unit}"
                for unit in ("@mill.service", "-page@mill.service", "-page@mill.socket")
            ),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={"SYSTEMD_UNIT_PATH": f"{units}:/lib/systemd/system", "PATH": "/usr/bin:/bin"},
    )
    assert (done.returncode, done.stderr) == (0, "")
