"""The systemd files of a survey's service: unit, rules, token, and a drop-in that permits only the
devices of this survey.

The contents of all files follow from the survey file. So a repeated installation leaves correct
files unchanged, and the removal finds the installed files.
"""

import ipaddress
import os
import secrets
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal

from stepdiag.base.errors import UsageError, system_words
from stepdiag.base.files import write_atomically
from stepdiag.base.messages import message
from stepdiag.daemon.program_places import PACKAGED, at_its_places, places_of_program
from stepdiag.daq.links.ports.address import network_line
from stepdiag.daq.survey.file import load_survey
from stepdiag.daq.survey.models import Survey
from stepdiag.page.settings import CERTIFICATE, KEY, TOKEN, is_loopback

SURVEYS = Path("etc/stepdiag")
UNITS = Path("etc/systemd/system")
UNIT = "stepdiag@.service"
PAGE, PAGE_SOCKET, ACCOUNTS = (
    "stepdiag-page@.service",
    "stepdiag-page@.socket",
    "stepdiag.sysusers.conf",
)
SHARED = {
    **{unit: UNITS / unit for unit in (UNIT, PAGE, PAGE_SOCKET)},
    ACCOUNTS: Path("etc/sysusers.d/stepdiag.conf"),
    "90-stepdiag.rules": Path("etc/udev/rules.d/90-stepdiag.rules"),
    "stepdiag.modules.conf": Path("etc/modules-load.d/stepdiag.conf"),
}
"""Files that all surveys of a computer share: their names in the package, and their paths on the
computer."""
DROP_IN = "50-survey.conf"
PRIVATE_NETWORKS = ("link-local", "10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "fc00::/7")
"""Private networks that can reach a page that is open to other computers."""
TOKEN_BYTES = 18
"""Number of random bytes of a token: 144 bits cannot be guessed."""
WRITTEN = (
    "# Written by `stepdiag service install`; lines of your own go into another drop-in.\n"
)


@dataclass(frozen=True, slots=True)
class Step:
    """A file of the installation and its change. The text of a secret is never shown."""

    path: Path
    does: Literal["write", "keep", "remove", "make secret"]
    text: str = ""


def plan_install(survey_file: Path, root: Path) -> list[Step]:
    """Return the steps of an installation below ``root``. Raises UsageError for an invalid survey
    file, or a survey file outside the folder of the service."""
    survey = load_survey(survey_file)
    name = name_of(survey_file, root)
    steps = [
        step for source, place in SHARED.items() for step in shared_steps(source, place, root)
    ]
    token = survey_file.parent / survey.page.token_file
    if survey.page.token_file:
        steps.append(Step(token, "keep" if token.exists() else "make secret"))
    wanted = drop_ins(name, survey, Path("/") / SURVEYS)
    places = [_of(unit, name) for unit in (PAGE, PAGE_SOCKET)]
    stale = [
        Step(root / place, "remove")
        for place in places
        if place not in wanted and (root / place).exists()
    ]
    return [*steps, *stale, *(written(root / path, text) for path, text in wanted.items())]


def plan_removal(survey_file: Path, root: Path) -> list[Step]:
    """Return the files to remove: the drop-in of a survey, and after the last survey the shared
    files. Survey file, token and data stay."""
    name = name_of(survey_file, root)
    own = [root / _of(unit, name) for unit in (UNIT, PAGE, PAGE_SOCKET)]
    others = [
        path
        for path in (root / UNITS).glob(f"stepdiag@*.service.d/{DROP_IN}")
        if path not in own
    ]
    places = [*own, *([] if others else [root / place for place in SHARED.values()])]
    return [Step(path, "remove") for path in places if path.exists()]


def carry_out(steps: list[Step]) -> None:
    """Execute the steps of an installation. Raises UsageError for a file that cannot be written."""
    for step in steps:
        try:
            _do(step)
        except OSError as error:
            raise UsageError(
                str(step.path),
                expected=message("writable-as-root"),
                found=system_words(error),
            ) from error


def drop_ins(name: str, survey: Survey, folder: Path) -> dict[Path, str]:
    """Return the systemd drop-ins of a survey by their paths. The recorder's drop-in contains the
    devices. The page's drop-in contains the addresses and the credentials in ``folder``. Raises
    UsageError.
    """
    texts = {_of(UNIT, name): ("Service", _network(survey))}
    if survey.page.enabled or survey.metrics.enabled:
        texts |= {
            _of(PAGE, name): ("Service", _credentials(survey, folder)),
            _of(PAGE_SOCKET, name): ("Socket", _addresses(survey)),
        }
    return {
        place: WRITTEN + f"[{section}]\n" + "".join(f"{line}\n" for line in lines)
        for place, (section, lines) in texts.items()
    }


def _do(step: Step) -> None:
    match step.does:
        case "write":
            step.path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(step.path, step.text.encode())
            step.path.chmod(0o644)
        case "make secret":
            with os.fdopen(
                os.open(step.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600),
                "w",
                encoding="utf-8",
            ) as file:
                file.write(secrets.token_urlsafe(TOKEN_BYTES) + "\n")
        case "remove":
            step.path.unlink()
            if step.path.name == DROP_IN and not any(step.path.parent.iterdir()):
                step.path.parent.rmdir()


def written(path: Path, text: str) -> Step:
    """Return the step that writes a text into a file; its action is ``keep`` if the file already
    has this text."""
    try:
        same = path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        same = False
    return Step(path, "keep" if same else "write", text)


def name_of(survey_file: Path, root: Path) -> str:
    """Return the name of the instance of a survey file. Raises UsageError for a file that the
    systemd unit would not find."""
    expected = root / SURVEYS
    name = survey_file.stem
    plain = name.isascii() and all(letter.isalnum() or letter in "._-" for letter in name)
    if (
        survey_file.suffix != ".toml"
        or survey_file.absolute().parent != expected.absolute()
        or not plain
    ):
        raise UsageError(
            str(survey_file),
            expected=message("survey-file-there", folder=str(expected)),
            found=str(survey_file.absolute()),
            remedy=message("copy-it-there"),
        )
    return name


def _of(unit: str, name: str) -> Path:
    return UNITS / f"{unit.replace('@', f'@{name}')}.d" / DROP_IN


def shared_steps(source: str, place: Path, root: Path) -> Iterator[Step]:
    """Yield the steps for a file that all surveys share.

    If a package contains the file, no copy is written to /etc: after an upgrade of the package,
    systemd would still read the old copy.
    """
    packaged = root / "usr/lib" / place.relative_to("etc")
    if packaged.is_file() and sys.prefix == PACKAGED:
        yield from (Step(each, "remove") for each in (root / place,) if each.is_file())
    else:
        yield written(root / place, shared(source, root))


def shared(source: str, root: Path) -> str:
    """Return the text of a systemd file of this program; a unit contains the folders of this
    installation. Raises UsageError."""
    for folder in (
        Path(sys.prefix) / "share/stepdiag/systemd",
        Path(str(files("stepdiag"))).parent / "systemd",
    ):
        if (folder / source).is_file():
            text = (folder / source).read_text(encoding="utf-8")
            return (
                at_its_places(text, places_of_program(), reachable=root == Path("/"))
                if source.endswith(".service")
                else text
            )
    raise UsageError(
        source,
        expected=message("systemd-files"),
        found=message("none"),
        remedy=message("wheel-again"),
    )


def _network(survey: Survey) -> Iterator[str]:
    allowed = [
        each
        for host in _devices(survey)
        if not is_loopback(host)
        for each in address_of(host) or PRIVATE_NETWORKS
    ]
    yield "IPAddressAllow="
    yield from (f"IPAddressAllow={each}" for each in ("localhost", *dict.fromkeys(allowed)))


def _devices(survey: Survey) -> Iterator[str]:
    plc = survey.plc
    if plc.transport in ("tcp", "s7", "lsv2"):
        yield plc.host
    instruments = [
        each.port
        for each in (survey.laser, survey.head, survey.air_sensor)
        if each is not None
    ]
    ports = [*instruments, plc.serial_port * (plc.transport == "rtu")]
    yield from (line.host for line in map(network_line, ports) if line is not None)


def _addresses(survey: Survey) -> Iterator[str]:
    served = [each for each in (survey.page, survey.metrics) if each.enabled]
    yield "ListenStream="
    for each in served:
        (host,) = address_of("127.0.0.1" if each.host == "localhost" else each.host) or [""]
        if not host:
            raise UsageError(
                "page.host, metrics.host",
                expected=message("own-address"),
                found=repr(each.host),
            )
        yield f"ListenStream={f'[{host}]' if ':' in host else host}:{each.port}"
    if not all(is_loopback(each.host) for each in served):
        yield from (f"IPAddressAllow={each}" for each in PRIVATE_NETWORKS)


def _credentials(survey: Survey, folder: Path) -> Iterator[str]:
    page = survey.page
    for name, file in (
        (TOKEN, page.token_file),
        (CERTIFICATE, page.certificate),
        (KEY, page.key),
    ):
        if not file:
            continue
        if not all(letter.isalnum() or letter in "._-/" for letter in file):
            raise UsageError(
                message("file-for", name=name),
                expected=message("name-plain"),
                found=repr(file),
            )
        yield f"LoadCredential={name}:{folder / file}"


def address_of(host: str) -> list[str]:
    """Return the address of a host without the name of a network interface; empty for a host
    name."""
    try:
        return [str(ipaddress.ip_address(host.partition("%")[0]))]
    except ValueError:
        return []
