"""Where the page's token may stand, and where not."""

from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daq.log.recovery import log_info
from stepdiag.daq.survey.file import load_survey, parse_survey
from stepdiag.page.settings import in_the_clear, page_settings
from testkit.recording import HEADER, write_log
from testkit.running.survey_files import SMALLEST

TOKEN = "sixteen letters!"


def survey_with(folder: Path, page: str) -> Path:
    """Write a survey file with these lines in its page section."""
    path = folder / "mill.toml"
    path.write_text(f"{SMALLEST}[page]\n{page}\n", encoding="utf-8")
    return path


def settings_of(path: Path):
    """Return how the page of a survey file would be served."""
    return page_settings(path, load_survey(path))


def secret(folder: Path, text: str, mode: int = 0o600) -> Path:
    """Write a secret."""
    path = folder / "mill.token"
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    return path


def test_a_survey_file_with_a_token_is_refused_with_the_way_out(tmp_path: Path) -> None:
    """Every log carries the survey file: the refusal does not even repeat the token. A log of an
    older version is still read."""
    path = survey_with(tmp_path, f'token = "{TOKEN}"')
    with pytest.raises(UsageError, match=r"page\.token: .*page\.token_file") as refused:
        load_survey(path)
    assert TOKEN not in str(refused.value)
    assert parse_survey(path.read_text(), "0001.mcap").page.token == TOKEN


def test_a_token_file_is_read(tmp_path: Path) -> None:
    secret(tmp_path, f"{TOKEN}\n")
    assert settings_of(survey_with(tmp_path, 'token_file = "mill.token"')).token == TOKEN


def test_without_one_the_page_only_shows(tmp_path: Path) -> None:
    assert settings_of(survey_with(tmp_path, "")).token == ""


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660])
def test_a_secret_that_others_may_read_is_none(tmp_path: Path, mode: int) -> None:
    secret(tmp_path, TOKEN, mode)
    with pytest.raises(UsageError, match=r"chmod 600 mill\.token, found mode"):
        settings_of(survey_with(tmp_path, 'token_file = "mill.token"'))


@pytest.mark.parametrize("text", ["", "secret", "fifteen letters", " " * 40, "a\x07" * 20])
def test_a_token_that_can_be_guessed_is_refused(tmp_path: Path, text: str) -> None:
    secret(tmp_path, text)
    with pytest.raises(UsageError, match="16 printable characters") as refused:
        settings_of(survey_with(tmp_path, 'token_file = "mill.token"'))
    assert not text.strip() or text not in str(refused.value)


def test_a_credential_of_the_service_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """systemd hands it over in a folder that only the service reads."""
    credentials = tmp_path / "credentials"
    credentials.mkdir()
    (credentials / "page-token").write_text("the service's own token", encoding="utf-8")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(credentials))
    assert (
        settings_of(survey_with(tmp_path, 'token_file = "not-there"')).token
        == "the service's own token"
    )


def test_a_file_named_like_a_credential_is_none(tmp_path: Path) -> None:
    secret(tmp_path, TOKEN, 0o644).rename(tmp_path / "page-token")
    with pytest.raises(UsageError, match="chmod 600 page-token, found mode"):
        settings_of(survey_with(tmp_path, 'token_file = "page-token"'))


def test_a_missing_token_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"page\.token_file: .*gone\.token"):
        settings_of(survey_with(tmp_path, 'token_file = "gone.token"'))


def test_no_certificate_is_no_encryption(tmp_path: Path) -> None:
    (tmp_path / "mill.crt").write_text("none", encoding="utf-8")
    secret(tmp_path, "none")
    with pytest.raises(UsageError, match=r"page\.certificate, page\.key"):
        settings_of(survey_with(tmp_path, 'certificate = "mill.crt"\nkey = "mill.token"'))
    with pytest.raises(UsageError, match="certificate and key, or neither"):
        load_survey(survey_with(tmp_path, 'certificate = "mill.crt"'))


@pytest.mark.parametrize(
    ("host", "seen"),
    [
        ("127.0.0.1", False),
        ("::1", False),
        ("localhost", False),
        ("0.0.0.0", True),
        ("10.0.0.5", True),
    ],
)
def test_who_can_listen_on_the_way(tmp_path: Path, host: str, seen: bool) -> None:
    survey = survey_with(tmp_path, f'host = "{host}"')
    assert in_the_clear(load_survey(survey).page, settings_of(survey)) is seen


@pytest.mark.parametrize("name", ["a b", "evil.example/", "-x", "", "x\\n"])
def test_a_name_that_is_none_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"page\.names"):
        load_survey(survey_with(tmp_path, f'names = ["{name}"]'))


def test_info_names_a_log_that_carries_a_token(tmp_path: Path) -> None:
    """Logs of older versions hold the survey file as it was: who passes one on must know."""
    for name, survey in (
        ("clean", SMALLEST),
        ("telling", f'{SMALLEST}[page]\ntoken = "{TOKEN}"\n'),
    ):
        write_log(tmp_path / f"{name}.mcap", [], header=replace(HEADER, survey_text=survey))
    assert not log_info(tmp_path / "clean.mcap").carries_token
    assert log_info(tmp_path / "telling.mcap").carries_token
