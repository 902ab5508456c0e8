"""What is published of a survey: by its schema, only when it changed, and nothing of a result that
is damaged."""

import errno
import os
from pathlib import Path

import msgspec
import pytest

from stepdiag.base.result.result import parse_result
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.models import Survey
from stepdiag.publish.messages import (
    Findings,
    Message,
    ResultMessage,
    State,
    Watched,
    schemas,
    topic_of,
)
from testkit.cli import stepdiag
from testkit.hostile.foreign import targets
from testkit.hostile.foreign_logs import SURVEY

ALONE = SURVEY[: SURVEY.index("[[export]]")]
"""The survey file without those that it names."""


@pytest.fixture
def survey() -> Survey:
    return parse_survey(
        SURVEY.replace('machine = "virtual"', 'machine = "Mill/+#7"'), "s.toml"
    )


@pytest.fixture
def watched(survey: Survey, tmp_path: Path) -> Watched:
    """A survey with a result in its second round."""
    (tmp_path / "0001").mkdir()
    (tmp_path / "0002").mkdir()
    (tmp_path / "0002" / "result.json").write_bytes(targets()["result"].seed)
    return Watched(survey, tmp_path)


def test_before_anything_was_recorded_only_the_state_is_said(
    survey: Survey, tmp_path: Path
) -> None:
    (said,) = Watched(survey, tmp_path / "nowhere").now()
    assert isinstance(said, State)
    assert (said.recording, said.complete, said.round) == (False, False, "")


def test_the_numbers_are_those_of_the_result(watched: Watched, tmp_path: Path) -> None:
    state, findings, result = watched.now()
    assert isinstance(state, State)
    assert isinstance(findings, Findings)
    assert isinstance(result, ResultMessage)
    solved = parse_result((tmp_path / "0002" / "result.json").read_text(encoding="utf-8"))
    assert (state.complete, result.round) == (True, "0002")
    assert {
        row.quantity: row.value for row in result.rows if row.quantity in solved.squareness
    } == {
        name: number.value
        for name, number in solved.squareness.items()
        if number.value is not None
    }
    assert [each.code for each in findings.findings] == [
        each.code for each in solved.findings
    ]


def test_every_message_is_read_by_its_schema_and_no_other_form_is(watched: Watched) -> None:
    said = [*watched.now(), watched.online(online=True)]
    encoded = [msgspec.json.encode(each) for each in said]
    assert [msgspec.json.decode(each, type=Message) for each in encoded] == said
    names = {msgspec.json.decode(each)["schema"] for each in encoded}
    assert (
        names
        == set(schemas())
        == set(msgspec.json.decode(stepdiag("publish", "--schema").out))
    )
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(
            encoded[0].replace(b"stepdiag-state", b"stepdiag-result"), type=Message
        )


def test_a_result_is_read_anew_when_its_file_is_another(
    watched: Watched, tmp_path: Path
) -> None:
    before = list(watched.now())
    path = tmp_path / "0002" / "result.json"
    path.write_bytes(path.read_bytes() + b"\n")
    assert watched.now()[0] == before[0]
    assert list(watched.now())[2] != before[2]


def test_a_damaged_result_is_named_and_holds_nothing_else_back(
    watched: Watched, tmp_path: Path
) -> None:
    """The state is said all the same; what is sent once ends the program, since nobody looks
    again."""
    path = tmp_path / "0002" / "result.json"
    whole = path.read_bytes()
    (tmp_path / "0001" / "result.json").write_bytes(whole)
    path.write_text("{", encoding="utf-8")
    (state,) = watched.now()
    assert isinstance(state, State)
    assert (state.round, state.complete) == ("0002", True)
    assert "0002/result.json" in state.damage
    assert [said.round for _, said in watched.history()] == ["0001"], (
        "an older result is read all the same"
    )
    path.write_bytes(whole)
    mended, *told = watched.now()
    assert isinstance(mended, State)
    assert (mended.damage, len(told)) == ("", 2)


def test_a_share_that_is_away_is_named_and_ends_nothing(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever of the folder is asked for: a server on the network that went away answers nothing
    (ESTALE)."""

    def away(path: Path) -> bool:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(path))

    monkeypatch.setattr(Path, "is_file", away)
    (state,) = watched.now()
    assert isinstance(state, State)
    assert (state.complete, os.strerror(errno.ESTALE) in state.damage) == (False, True)
    monkeypatch.setattr(Path, "is_dir", away)
    assert list(watched.history()) == []


def test_a_name_cannot_part_a_topic(survey: Survey) -> None:
    assert topic_of(State, survey, "a/b") == "a/b/Mill%2F%2B%237/bench/state"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "HOST"),
        (("--broker", "a", "--opcua", "b"), "found both"),
        (("--opcua", "127.0.0.1"), "found neither"),
        (("--opcua", "127.0.0.1", "--certificate", "x.pem"), "found one of the two"),
        (("--opcua", "127.0.0.1", "--certificate", "x.pem", "--key", "k"), "--key"),
        (
            ("--opcua", "127.0.0.1", "--certificate", "nowhere.pem", "--key", "p"),
            "nowhere.pem",
        ),
        (
            ("--opcua", "127.0.0.1", "--certificate", "s.toml", "--key", "p"),
            "a certificate and its key",
        ),
        (("--opcua", "127.0.0.1", "--certificate", "x.pem", "--key", "open"), "chmod 600"),
        (
            ("--opcua", "127.0.0.1", "--certificate", "x.pem", "--key", "p", "--plain"),
            "found both",
        ),
        (("--opcua", "127.0.0.1:0", "--plain"), "HOST:PORT"),
        (("--opcua", "::1", "--plain"), "[ADDRESS]:PORT"),
        (("--opcua", "127.0.0.1", "--plain", "--once"), "without --once"),
        (("--opcua", "127.0.0.1", "--plain", "--user", "u"), "a password for the user"),
        (
            ("--opcua", "192.0.2.1", "--plain", "--user", "u", "--password-file", "p"),
            "encryption, since a password is sent",
        ),
        (("--broker", "a", "--certificate", "x.pem"), "without --certificate"),
        (("--broker", "a b"), "HOST:PORT"),
        (("--broker", "a:99999"), "HOST:PORT"),
        (("--broker", "a:x"), "HOST:PORT"),
        (("--broker", "a:0000001883"), "HOST:PORT"),
        (("--broker", "[::1]:x"), "HOST:PORT"),
        (("--broker", "[::1]:1883:1"), "HOST:PORT"),
        (
            ("--broker", "[fd00::1]:1883", "--plain", "--password-file", "p"),
            "broker fd00::1:",
        ),
        (("--broker", "a", "--topic", "a/#"), "a topic without the wildcards"),
        (
            ("--broker", "a", "--plain", "--password-file", "p"),
            "encryption, since a password is sent",
        ),
        (("--broker", "a", "--password-file", "p"), "a user for the password"),
        (("--broker", "a", "--plain", "--ca", "x.pem"), "either --ca or --plain"),
        (("--broker", "a", "--password-file", "open"), "chmod 600"),
        (("--broker", "a", "--ca", "s.toml"), "certificates in PEM"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "stepdiag.daemon.journal.configure", lambda: None
    )  # it lasts: other tests would write to this one's terminal
    Path("s.toml").write_text(ALONE, encoding="utf-8")
    Path("p").touch(0o600)
    Path("p").write_text("secret", encoding="utf-8")
    Path("open").write_text("secret", encoding="utf-8")
    Path("open").chmod(0o644)
    told = stepdiag("publish", "s.toml", *options)
    assert (told.code, words in told.refusal) == (2, True), told
