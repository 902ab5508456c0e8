"""Settings of a survey's page, and its secrets: the token and the key of the TLS certificate.

A secret is a credential of the service (systemd's ``LoadCredential``), or a file beside the survey
file that only its owner can read. Survey files and logs contain no secrets.
"""

import ipaddress
import os
import ssl
import stat
from contextlib import suppress
from pathlib import Path

from stepdiag.base.errors import UsageError, system_words
from stepdiag.base.files import as_text, read_bytes
from stepdiag.base.messages import message
from stepdiag.daq.survey.models import Page, Survey
from stepdiag.page.messages import PageSettings

TOKEN, CERTIFICATE, KEY = "page-token", "page-certificate", "page-key"
"""Names of the secrets as credentials of the service."""
SHORTEST_TOKEN = 16
"""Smallest number of characters of a token: shorter tokens can be guessed."""
LONGEST_TOKEN_BYTES = 1000
"""Largest size in bytes of a file with a token or password."""


def page_settings(survey_file: Path, survey: Survey) -> PageSettings:
    """Return the settings of the page, and make the folder that the page shows.

    Raises UsageError for a secret that others can read, a short token, an invalid certificate.
    """
    page = survey.page
    token = secret_file(survey_file, TOKEN, page.token_file, "page.token_file")
    certificate = _file(survey_file, CERTIFICATE, page.certificate)
    key = secret_file(survey_file, KEY, page.key, "page.key")
    if certificate is not None and key is not None:
        _refuse_no_certificate(certificate, key, survey_file.name)
    folder = survey.folder(survey_file).resolve()
    # The page gets access only to a folder that exists now; the daemon reports a missing folder.
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return PageSettings(
        folder=str(folder),
        token="" if token is None else _token_in(token),
        names=page.names,
        certificate="" if certificate is None or key is None else str(certificate.resolve()),
        key="" if certificate is None or key is None else str(key.resolve()),
        language=page.language,
    )


def in_the_clear(page: Page, settings: PageSettings) -> bool:
    """Return whether the messages of the page cross the network unencrypted."""
    return not settings.certificate and not is_loopback(page.host)


def is_loopback(host: str) -> bool:
    """Return whether a host name means this computer itself."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _file(survey_file: Path, credential: str, named: str) -> Path | None:
    """Return the file of a secret: the service's credential, otherwise the file beside the survey
    file, otherwise None."""
    given = _credential(credential)
    if given is not None and given.is_file():
        return given
    return survey_file.parent / named if named else None


def _credential(name: str) -> Path | None:
    """Return the path of the service's credential with this name, or None outside a service."""
    return (
        Path(os.environ["CREDENTIALS_DIRECTORY"]) / name
        if "CREDENTIALS_DIRECTORY" in os.environ
        else None
    )


def secret_file(survey_file: Path, credential: str, named: str, field: str) -> Path | None:
    """Return the file of a secret. Raises UsageError for a missing file or a file that other users
    can read."""
    path = _file(survey_file, credential, named)
    if path is None or path == _credential(credential):
        return path
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
    except OSError as error:
        raise UsageError(
            f"{survey_file.name}: {field}",
            expected=message("readable-file-of", name=named),
            found=system_words(error),
        ) from error
    if mode & 0o077:
        raise UsageError(
            f"{survey_file.name}: {field}",
            expected=message("owner-only-file", name=named),
            found=message("file-mode", mode=f"{mode:o}"),
        )
    return path


def secret(survey_file: Path, credential: str, named: str, field: str) -> str:
    """Return a secret of one line, empty if no file is named. Raises the UsageError of
    `secret_file`, and UsageError for a text of several lines."""
    path = secret_file(survey_file, credential, named, field)
    if path is None:
        return ""
    text = as_text(
        read_bytes(path, largest=LONGEST_TOKEN_BYTES, blame=UsageError), path.name, UsageError
    ).removesuffix("\n")
    if not text or not text.isprintable():
        raise UsageError(
            f"{survey_file.name}: {field}",
            expected=message("one-printable-line", name=path.name),
            found=message("something-else"),
        )
    return text


def _token_in(path: Path) -> str:
    token = as_text(
        read_bytes(path, largest=LONGEST_TOKEN_BYTES, blame=UsageError), path.name, UsageError
    ).strip()
    if len(token) < SHORTEST_TOKEN or not token.isprintable():
        raise UsageError(
            path.name,
            expected=message("token-of-characters", count=SHORTEST_TOKEN),
            found=str(len(token)),
            remedy=f"head -c 18 /dev/urandom | base64 > {path.name}",
        )
    return token


def _refuse_no_certificate(certificate: Path, key: Path, source: str) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        raise UsageError(
            f"{source}: page.certificate, page.key",
            expected=message("certificate-and-key"),
            found=str(error),
        ) from error
