"""`stepdiag publish` against a real broker with TLS and a password: what arrives, what is left when
it dies, and a broker that is away."""

import hashlib
import signal
import subprocess
import sys
import time

import pytest

from testkit.fleets import finished_survey
from testkit.hostile.foreign_logs import SURVEY
from testkit.running.brokers import PASSWORD, PATIENCE_S, USER, heard, prepared, running

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

TOPICS = "works/Mill 7%2F%C3%A4/bench"
EVERYTHING = {"online", "state", "findings", "result"}


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """The survey file of a finished survey, with the broker's password beside it."""
    folder = tmp_path_factory.mktemp("survey")
    finished_survey(folder / "bench")
    file = folder / "mill.toml"
    file.write_text(
        SURVEY[: SURVEY.index("[[export]]")].replace(
            'machine = "virtual"', 'machine = "Mill 7/ä"'
        )
    )
    password = folder / "mqtt.password"
    password.touch(0o600)
    password.write_text(PASSWORD + "\n")
    return file


@pytest.fixture
def broker(tmp_path):
    return prepared(tmp_path)


def command(survey, place, *options):
    address = f"127.0.0.1:{place.port}"
    return [
        sys.executable,
        "-m",
        "stepdiag",
        "publish",
        survey,
        "--broker",
        address,
        "--ca",
        place.authority,
        "--user",
        USER,
        "--password-file",
        "mqtt.password",
        "--topic",
        "works",
        "--every",
        "0.2",
        *options,
    ]


class Publishing:
    """A publisher that runs; ``said`` is what it has said so far."""

    def __init__(self, survey, place):
        self._log = place.folder / f"publish-{time.monotonic_ns()}.log"
        with self._log.open("wb") as out:
            self.process = subprocess.Popen(
                [*map(str, command(survey, place))], stdout=out, stderr=out
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(PATIENCE_S)

    @property
    def said(self):
        return self._log.read_text()

    def until_said(self, words):
        end = time.monotonic() + PATIENCE_S
        while words not in self.said:
            assert self.process.poll() is None, self.said
            assert time.monotonic() < end, self.said
            time.sleep(0.1)


def files_of(survey):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in survey.parent.rglob("*")
        if path.is_file()
    }


def test_a_newcomer_hears_everything_and_learns_when_the_publisher_dies(survey, broker):
    before = files_of(survey)
    with running(broker):
        with Publishing(survey, broker) as publishing:
            held = heard(broker, lambda said: set(said) == EVERYTHING)
            assert set(held) == {f"{TOPICS}/{what}" for what in EVERYTHING}
            assert held[f"{TOPICS}/online"]["online"] is True
            assert held[f"{TOPICS}/state"]["complete"] is True
            result = held[f"{TOPICS}/result"]
            assert (
                result["sha256"]
                == hashlib.sha256(
                    (survey.parent / "bench/0001/result.json").read_bytes()
                ).hexdigest()
            )
            assert {row["quantity"] for row in result["rows"]} >= {
                "EXX",
                "EYY",
                "EZZ",
                "volumetric-rms",
            }
            publishing.process.send_signal(signal.SIGKILL)
            publishing.process.wait(PATIENCE_S)
            heard(
                broker,
                lambda said: set(said) == EVERYTHING and said["online"]["online"] is False,
            )  # the will
        with Publishing(survey, broker) as publishing:
            heard(broker, lambda said: said.get("online", {}).get("online") is True)
            publishing.process.send_signal(signal.SIGTERM)
            assert publishing.process.wait(PATIENCE_S) == 0, publishing.said
            heard(broker, lambda said: said.get("online", {}).get("online") is False)
    assert files_of(survey) == before
    assert PASSWORD not in publishing.said


def test_a_broker_that_is_away_is_waited_for_and_hears_everything_again(survey, broker):
    with Publishing(survey, broker) as publishing:
        publishing.until_said("broker-away")
        with running(broker):
            heard(broker, lambda said: set(said) == EVERYTHING)
        publishing.until_said("broker-connected")
        with running(broker):  # it kept nothing
            heard(
                broker,
                lambda said: set(said) == EVERYTHING and said["online"]["online"] is True,
            )


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("--user", "nobody"), "check user and password"),
        (
            ("--ca", "/etc/ssl/certs/ca-certificates.crt"),
            "give the certificate of the authority",
        ),
    ],
)
def test_a_broker_that_refuses_ends_it_in_words(survey, broker, changed, words):
    with running(broker):
        done = subprocess.run(
            [*map(str, command(survey, broker, *changed))],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    assert done.returncode == 4, done.stderr
    assert words in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_once_sends_everything_and_ends(survey, broker):
    with running(broker):
        done = subprocess.run(
            [*map(str, command(survey, broker, "--once"))],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        heard(broker, lambda said: set(said) == EVERYTHING - {"online"})
    away = subprocess.run(
        [*map(str, command(survey, broker, "--once"))],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert away.returncode == 4, away.stderr
