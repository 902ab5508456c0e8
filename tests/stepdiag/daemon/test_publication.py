"""`stepdiag publish` as a service: what is written, to whom it opens a way, and what is taken away
again."""

import subprocess
from pathlib import Path

import pytest

from testkit.cli import stepdiag
from testkit.installing import SURVEY, root_with, service, written

UNIT = "etc/systemd/system/stepdiag-publish@.service"
DROP_IN = "etc/systemd/system/stepdiag-publish@mill.service.d/50-survey.conf"
BROKER = ("--broker", "192.168.4.30:8883", "--ca", "/etc/stepdiag/works.pem")
NETWORKS = ["link-local", "10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "fc00::/7"]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return root_with(tmp_path, SURVEY)


def lines(root: Path, key: str) -> list[str]:
    return [
        line.partition("=")[2]
        for line in (root / DROP_IN).read_text().splitlines()
        if line.startswith(f"{key}=")
    ]


def test_the_broker_alone_is_reached_and_secrets_are_credentials(root: Path) -> None:
    for secret in ("mqtt-user", "mqtt-password", "opcua-key"):
        (root / f"etc/stepdiag/mill.{secret}").write_text("not-to-be-guessed")
    told = service("publish", root, *BROKER)
    assert all(
        f"credential {each}: mill.{each} found" in told
        for each in ("mqtt-user", "mqtt-password")
    )
    assert lines(root, "IPAddressAllow") == ["", "localhost", "192.168.4.30"]
    assert lines(root, "SocketBindAllow") == []
    assert lines(root, "Environment") == [
        'PUBLISH="--broker 192.168.4.30:8883 --ca /etc/stepdiag/works.pem"'
    ]
    assert lines(root, "LoadCredential") == [
        f"{each}:/etc/stepdiag/mill.{each}" for each in ("mqtt-user", "mqtt-password")
    ]
    assert "not-to-be-guessed" not in (root / DROP_IN).read_text() + (root / UNIT).read_text()


@pytest.mark.parametrize(
    ("options", "reached", "bound"),
    [
        (("--broker", "broker.works"), NETWORKS, []),
        (("--broker", "127.0.0.1", "--plain"), [], []),
        (
            ("--opcua", "192.168.4.2", "--certificate", "/etc/stepdiag/server.pem"),
            NETWORKS,
            ["tcp:4840"],
        ),
        (("--opcua", "127.0.0.1:4900", "--plain"), [], ["tcp:4900"]),
    ],
)
def test_a_name_or_a_server_is_opened_to_private_networks(
    root: Path, options: tuple[str, ...], reached: list[str], bound: list[str]
) -> None:
    service("publish", root, *options)
    assert lines(root, "IPAddressAllow") == ["", "localhost", *reached]
    assert lines(root, "SocketBindAllow") == bound


def test_absent_secrets_are_said(root: Path) -> None:
    told = service(
        "publish", root, "--opcua", "127.0.0.1", "--certificate", "/etc/stepdiag/server.pem"
    )
    for each in ("opcua-user", "opcua-password", "opcua-key"):
        assert (
            f"credential {each}: mill.{each} is missing, so this credential is left out"
            in told
        )
    assert lines(root, "LoadCredential") == []


@pytest.mark.parametrize("alone", ["user", "password"])
@pytest.mark.parametrize("kind", ["mqtt", "opcua"])
def test_user_and_password_go_together(root: Path, kind: str, alone: str) -> None:
    (root / f"etc/stepdiag/mill.{kind}-{alone}").write_text("x")
    way = (
        ("--broker", "127.0.0.1", "--plain")
        if kind == "mqtt"
        else ("--opcua", "127.0.0.1", "--plain")
    )
    told = stepdiag(
        "service", "publish", root / "etc/stepdiag/mill.toml", "--root", root, *way
    )
    assert (told.code, f"only mill.{kind}-{alone}" in told.refusal) == (2, True), told
    assert not (root / UNIT).exists()


def test_again_it_changes_nothing_and_a_dry_run_writes_nothing(root: Path) -> None:
    before = written(root)
    assert "IPAddressAllow=192.168.4.30" in service("publish", root, *BROKER, "--dry-run")
    assert written(root) == before
    service("publish", root, *BROKER)
    before = written(root)
    assert "write" not in service("publish", root, *BROKER)
    assert written(root) == before
    service("publish", root, "--broker", "192.168.4.31")
    assert {name for name, told in written(root).items() if told != before[name]} == {DROP_IN}


def test_it_goes_by_itself_or_with_its_survey(root: Path) -> None:
    """The unit that all share goes with the last one; secrets and surveys stay."""
    (root / "etc/stepdiag/lathe.toml").write_text(SURVEY, encoding="utf-8")
    for secret in ("mqtt-user", "mqtt-password"):
        (root / f"etc/stepdiag/mill.{secret}").write_text("secret")
    service("install", root)
    service("publish", root, *BROKER)
    service("publish", root, *BROKER, name="lathe")
    service("publish", root, "--remove", "--dry-run")
    assert (root / DROP_IN).exists()
    service("publish", root, "--remove")
    assert not (root / DROP_IN).parent.exists()
    assert (root / UNIT).exists()
    service("publish", root, *BROKER)
    service("remove", root)
    assert not (root / DROP_IN).exists()
    service("remove", root, name="lathe")
    assert set(written(root)) == {
        f"etc/stepdiag/{each}"
        for each in ("mill.toml", "lathe.toml", "mill.mqtt-user", "mill.mqtt-password")
    }
    assert "nothing to do" in service("publish", root, "--remove")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "neither"),
        (("--broker", "a", "--opcua", "b"), "both"),
        (("--broker", "a b"), "HOST:PORT"),
        (("--broker", "a", "--ca", '/etc/x" --plain'), "letters, digits"),
        (("--broker", "a", "--ca", "/etc/x\nExecStart=/bin/sh"), "letters, digits"),
        (("--broker", "a", "--ca", "/home/me/ca.pem"), "below /etc"),
        (("--broker", "a", "--ca", "ca.pem"), "below /etc"),
        (("--broker", "a", "--ca", "/etc/../home/me/ca.pem"), "below /etc"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    root: Path, options: tuple[str, ...], words: str
) -> None:
    told = stepdiag(
        "service", "publish", root / "etc/stepdiag/mill.toml", "--root", root, *options
    )
    assert (told.code, words in told.refusal) == (2, True), told
    assert not (root / UNIT).exists()


def test_a_survey_elsewhere_is_refused_with_the_way(root: Path) -> None:
    (root / "mill.toml").write_text(SURVEY, encoding="utf-8")
    told = stepdiag("service", "publish", root / "mill.toml", "--root", root, *BROKER)
    assert (told.code, "copy the survey file to this folder" in told.refusal) == (2, True)


def test_systemd_finds_nothing_wrong_with_what_is_written(root: Path) -> None:
    service("publish", root, *BROKER)
    done = subprocess.run(
        ["systemd-analyze", "verify", "stepdiag-publish@mill.service"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={
            "SYSTEMD_UNIT_PATH": f"{root}/etc/systemd/system:/lib/systemd/system",
            "PATH": "/usr/bin:/bin",
        },
    )
    assert (done.returncode, done.stderr) == (0, "")
