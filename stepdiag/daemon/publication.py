"""The systemd files of a publication: the unit, and a drop-in that permits only the receivers."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.daemon.installation import (
    DROP_IN,
    PRIVATE_NETWORKS,
    SURVEYS,
    UNITS,
    WRITTEN,
    Step,
    address_of,
    name_of,
    shared_steps,
    written,
)
from stepdiag.daq.links.ports.address import require_host_and_port
from stepdiag.daq.survey.file import load_survey
from stepdiag.page.settings import is_loopback

UNIT = "stepdiag-publish@.service"
_PLAIN = re.compile(r"[A-Za-z0-9._:/@\[\]-]+")
"""Pattern of a word without characters that have a special meaning in a unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Publication:
    """A publication to a broker or as an OPC UA server. ``port`` is the default port. The paths of
    files are absolute, below /etc."""

    broker: str = ""
    opcua: str = ""
    port: int
    ca: Path | None = None
    certificate: Path | None = None
    plain: bool = False

    @property
    def secrets(self) -> tuple[str, ...]:
        return (*self.who, *(() if self.broker or self.plain else ("opcua-key",)))

    @property
    def who(self) -> tuple[str, str]:
        """Return the names of the two credentials that contain user and password."""
        return (
            ("mqtt-user", "mqtt-password")
            if self.broker
            else ("opcua-user", "opcua-password")
        )


def plan_publication(survey_file: Path, root: Path, publication: Publication) -> list[Step]:
    """Return the steps of an installation below ``root``. Raises UsageError for an invalid survey
    file, or a survey file outside the folder of the service."""
    load_survey(survey_file)
    name = name_of(survey_file, root)
    text = drop_in(name, survey_file.parent, publication)
    return [*shared_steps(UNIT, UNITS / UNIT, root), written(root / _drop_in(name), text)]


def plan_end(survey_file: Path, root: Path) -> list[Step]:
    """Return the files to remove: the drop-in of a survey, and after the last published survey the
    unit. Secrets stay."""
    own = root / _drop_in(name_of(survey_file, root))
    others = [
        path
        for path in (root / UNITS).glob(f"stepdiag-publish@*.service.d/{DROP_IN}")
        if path != own
    ]
    return [
        Step(path, "remove")
        for path in (own, *([] if others else [root / UNITS / UNIT]))
        if path.exists()
    ]


def drop_in(name: str, folder: Path, publication: Publication) -> str:
    """Return the drop-in of a publication; secrets in ``folder`` with names like NAME.mqtt-user
    become credentials. Raises UsageError."""
    host, port = _address(publication)
    lines = [f"Environment=PUBLISH={_words(publication)}", "IPAddressAllow="]
    lines += [
        f"IPAddressAllow={each}" for each in ("localhost", *_reached(host, publication))
    ]
    lines += [f"SocketBindAllow=tcp:{port}"] * bool(publication.opcua)
    there = credentials(name, folder, publication)
    lines += [
        f"LoadCredential={each}:/{SURVEYS}/{name}.{each}"
        for each, found in there.items()
        if found
    ]
    return WRITTEN + "[Service]\n" + "".join(f"{line}\n" for line in lines)


def credentials(name: str, folder: Path, publication: Publication) -> dict[str, bool]:
    """Return, for each secret, whether ``folder`` contains it. Raises UsageError for a user without
    a password or a password without a user."""
    there = {each: (folder / f"{name}.{each}").is_file() for each in publication.secrets}
    user, password = publication.who
    if there[user] != there[password]:
        has, lacks = (user, password) if there[user] else (password, user)
        raise UsageError(
            str(folder),
            expected=message("option-pair", one=f"{name}.{has}", other=f"{name}.{lacks}"),
            found=message("alone-there", name=f"{name}.{has}"),
        )
    return there


def _words(publication: Publication) -> str:
    files = {"ca": publication.ca, "certificate": publication.certificate}
    places = {
        option: Path(os.path.normpath(path))
        for option, path in files.items()
        if path is not None
    }
    given: dict[str, str | Path] = {
        "broker": publication.broker,
        "opcua": publication.opcua,
        **places,
    }
    for option, value in given.items():
        if str(value) and not _PLAIN.fullmatch(str(value)):
            raise UsageError(
                f"--{option}",
                expected=message("letters-and", signs="._:/@[]-"),
                found=repr(str(value)),
            )
        if isinstance(value, Path) and Path("/etc") not in value.parents:
            raise UsageError(
                f"--{option}", expected=message("file-below-etc"), found=str(value)
            )
    words = [f"--{option} {value}" for option, value in given.items() if value]
    return '"' + " ".join([*words, *["--plain"] * publication.plain]) + '"'


def _address(publication: Publication) -> tuple[str, int]:
    option, text = (
        ("--broker", publication.broker)
        if publication.broker
        else ("--opcua", publication.opcua)
    )
    return require_host_and_port(option, text, publication.port)


def _reached(host: str, publication: Publication) -> Iterator[str]:
    if not is_loopback(host):
        yield from (
            PRIVATE_NETWORKS if publication.opcua else address_of(host) or PRIVATE_NETWORKS
        )


def _drop_in(name: str) -> Path:
    return UNITS / f"stepdiag-publish@{name}.service.d" / DROP_IN
