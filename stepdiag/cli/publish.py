"""``stepdiag publish``: state, findings and result of a survey to the shop's broker (extra ``stepdiag[mqtt]``)."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.cli.fleet import extra_needed
from stepdiag.solver.errors import UsageError

if TYPE_CHECKING:
    from stepdiag.publish.mqtt import Broker

PORT, SECURE_PORT = 1883, 8883
LARGEST_PORT = 65_535
MOST_DIGITS = 5


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("publish")(publish)


def publish(
    file: Annotated[Path | None, typer.Argument(help="The survey file.")] = None,
    broker: Annotated[str, typer.Option(help="HOST or HOST:PORT of the MQTT broker.")] = "",
    ca: Annotated[
        Path | None, typer.Option("--ca", help="The certificate of the broker's authority; without it the system's are trusted.")
    ] = None,
    plain: Annotated[bool, typer.Option("--plain", help="Without TLS.")] = False,
    user: Annotated[str, typer.Option(help="The user; without it the credential `mqtt-user`.")] = "",
    password_file: Annotated[
        str, typer.Option("--password-file", help="A file of mode 600 beside the survey file; the credential `mqtt-password` comes first.")
    ] = "",
    topic: Annotated[str, typer.Option(help="What the topics begin with.")] = "stepdiag",
    every: Annotated[float, typer.Option(help="Seconds between two looks at the survey.", min=0.2, max=3600)] = 5.0,
    once: Annotated[bool, typer.Option("--once", help="Send everything once, and end.")] = False,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of every message, and end.")] = False,
) -> None:
    """Send state, findings and result of a survey to an MQTT broker.

    Retained JSON under TOPIC/MACHINE/SURVEY/. Runs beside the recording and never touches it.
    """
    from stepdiag.publish.messages import schemas

    if schema:
        typer.echo(json.dumps(schemas(), indent=2))
        return
    if file is None or not broker:
        raise UsageError("publish", expected="a survey file and --broker HOST[:PORT]", found="neither" if file is None else "no broker")
    with extra_needed("mqtt"):
        from stepdiag.publish import mqtt
    from stepdiag.daemon.journal import configure
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.publish.messages import Watched

    if any(letter in topic for letter in "+#\0") or not topic.strip("/"):
        raise UsageError("--topic", expected="a topic without + and #", found=repr(topic))
    survey = load_survey(file)
    to = _broker(file, broker, ca, user, password_file, plain=plain)
    configure()
    mqtt.publish(Watched(survey, survey.folder(file)), survey, to, prefix=topic.strip("/"), every_s=every, once=once)


def _broker(file: Path, address: str, ca: Path | None, user: str, password_file: str, *, plain: bool) -> "Broker":
    from stepdiag.page.settings import is_loopback, secret
    from stepdiag.publish.mqtt import Broker

    if plain and ca is not None:
        raise UsageError("--plain", expected="--ca or --plain", found="both")
    host, port = _address(address, PORT if plain else SECURE_PORT)
    known_user = user or secret(file, "mqtt-user", "", "--user") or None
    password = secret(file, "mqtt-password", password_file, "--password-file") or None
    if plain and password is not None and not is_loopback(host):
        raise UsageError(
            f"broker {host}", expected="TLS, since a password is sent", found="--plain", remedy="leave --plain out, name --ca if needed"
        )
    if password is not None and known_user is None:
        raise UsageError(f"broker {host}", expected="a user for the password (--user, or the credential mqtt-user)", found="none")
    return Broker(host=host, port=port, secure=not plain, authority=ca, user=known_user, password=password)


def _address(text: str, port: int) -> tuple[str, int]:
    """Return host and port of HOST, HOST:PORT or [ADDRESS]:PORT."""
    without_port = text.endswith("]") or (text.count(":") > 1 and "]:" not in text)
    host, colon, number = (text, "", "") if without_port or ":" not in text else text.rpartition(":")
    if colon and not (number.isascii() and number.isdecimal() and len(number) <= MOST_DIGITS and 0 < int(number) <= LARGEST_PORT):
        raise UsageError("--broker", expected="HOST, HOST:PORT or [ADDRESS]:PORT", found=repr(text))
    host = host.removeprefix("[").removesuffix("]")
    if not host or any(letter.isspace() or letter in "/[]" for letter in host):
        raise UsageError("--broker", expected="HOST, HOST:PORT or [ADDRESS]:PORT", found=repr(text))
    return host, int(number) if colon else port
