"""``stepdiag publish``: state, findings and result of a survey to other programs (extras ``stepdiag[mqtt]``, ``stepdiag[opcua]``)."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.cli.fleet import extra_needed

if TYPE_CHECKING:
    from stepdiag.publish.mqtt import Broker
    from stepdiag.publish.opcua import Endpoint

PORT, SECURE_PORT, OPCUA_PORT = 1883, 8883, 4840


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("publish")(publish)


def publish(
    file: Annotated[Path | None, typer.Argument(help="The survey file.")] = None,
    broker: Annotated[str, typer.Option(help="HOST or HOST:PORT of the MQTT broker to send to.")] = "",
    opcua: Annotated[str, typer.Option(help="Or: ADDRESS or ADDRESS:PORT of this computer, where an OPC UA server is to listen.")] = "",
    ca: Annotated[
        Path | None, typer.Option("--ca", help="The certificate of the broker's authority; without it the system's are trusted.")
    ] = None,
    certificate: Annotated[Path | None, typer.Option(help="The OPC UA server's certificate (PEM).")] = None,
    key: Annotated[
        str, typer.Option(help="The key of this certificate: a file of mode 600 beside the survey file, or the credential `opcua-key`.")
    ] = "",
    plain: Annotated[bool, typer.Option("--plain", help="Without encryption.")] = False,
    user: Annotated[str, typer.Option(help="The user; without it the credential `mqtt-user` or `opcua-user`.")] = "",
    password_file: Annotated[
        str,
        typer.Option(
            "--password-file",
            help="A file of mode 600 beside the survey file; the credential `mqtt-password` or `opcua-password` comes first.",
        ),
    ] = "",
    topic: Annotated[str, typer.Option(help="What the topics begin with.")] = "stepdiag",
    every: Annotated[float, typer.Option(help="Seconds between two looks at the survey.", min=0.2, max=3600)] = 5.0,
    once: Annotated[bool, typer.Option("--once", help="Send everything once, and end.")] = False,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of every message, and end.")] = False,
) -> None:
    """Send a survey to an MQTT broker, or serve it by OPC UA.

    Retained JSON under TOPIC/MACHINE/SURVEY/, or results as OPC 40001-101 says. Runs beside the recording and never touches it.
    """
    from stepdiag.publish.messages import schemas

    if schema:
        typer.echo(json.dumps(schemas(), indent=2))
        return
    if file is None or bool(broker) == bool(opcua):
        found = "no survey file" if file is None else "both" if broker else "neither"
        raise UsageError("publish", expected="a survey file, and --broker HOST[:PORT] or --opcua ADDRESS[:PORT]", found=found)
    with extra_needed("mqtt" if broker else "opcua"):
        if broker:
            from stepdiag.publish import mqtt
        else:
            from stepdiag.publish import opcua as server
    from stepdiag.daemon.journal import configure
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.publish.messages import Watched

    if any(letter in topic for letter in "+#\0") or not topic.strip("/"):
        raise UsageError("--topic", expected="a topic without + and #", found=repr(topic))
    survey = load_survey(file)
    watched = Watched(survey, survey.folder(file))
    if broker:
        _refuse("--broker", certificate=certificate, key=key)
        to = _broker(file, broker, ca, user, password_file, plain=plain)
        configure()
        mqtt.publish(watched, survey, to, prefix=topic.strip("/"), every_s=every, once=once)
        return
    _refuse("--opcua", ca=ca, once=once)
    at = _endpoint(file, opcua, certificate, key, user, password_file, plain=plain)
    configure()
    server.serve(watched, survey, at, every_s=every)


def _broker(file: Path, address: str, ca: Path | None, user: str, password_file: str, *, plain: bool) -> "Broker":
    from stepdiag.publish.mqtt import Broker

    if plain and ca is not None:
        raise UsageError("--plain", expected="--ca or --plain", found="both")
    host, port = _address("--broker", address, PORT if plain else SECURE_PORT)
    known_user, password = _who(file, "mqtt", user, password_file, f"broker {host}", host, plain=plain)
    return Broker(host=host, port=port, secure=not plain, authority=ca, user=known_user, password=password)


def _endpoint(
    file: Path, address: str, certificate: Path | None, key: str, user: str, password_file: str, *, plain: bool
) -> "Endpoint":  # fmt: skip
    from stepdiag.page.settings import secret_file
    from stepdiag.publish.opcua import Endpoint

    own_key = secret_file(file, "opcua-key", key, "--key")
    own_key = own_key if own_key is not None and own_key.is_file() else None
    complete = certificate is not None and own_key is not None
    if plain == complete or (plain and (certificate is not None or key)):
        found = (
            "both" if plain else f"{'a certificate' if certificate is not None else 'no certificate'}, {'a key' if own_key else 'no key'}"
        )
        raise UsageError("--opcua", expected="--certificate and --key, or --plain", found=found)
    host, port = _address("--opcua", address, OPCUA_PORT)
    known_user, password = _who(file, "opcua", user, password_file, f"OPC UA server {host}", host, plain=plain)
    if known_user is not None and password is None:
        raise UsageError("--user", expected="a password for the user (--password-file, or the credential opcua-password)", found="none")
    return Endpoint(host=host, port=port, certificate=certificate, key=None if plain else own_key, user=known_user, password=password)


def _who(file: Path, kind: str, user: str, password_file: str, whom: str, host: str, *, plain: bool) -> tuple[str | None, str | None]:
    """Return user and password. Raises UsageError for a password without a user, and for one that others could read on the way."""
    from stepdiag.page.settings import is_loopback, secret

    known_user = user or secret(file, f"{kind}-user", "", "--user") or None
    password = secret(file, f"{kind}-password", password_file, "--password-file") or None
    if plain and password is not None and not is_loopback(host):
        remedy = "leave --plain out, name --ca if needed" if kind == "mqtt" else "leave --plain out, name --certificate and --key"
        raise UsageError(whom, expected="encryption, since a password is sent", found="--plain", remedy=remedy)
    if password is not None and known_user is None:
        raise UsageError(whom, expected=f"a user for the password (--user, or the credential {kind}-user)", found="none")
    return known_user, password


def _address(option: str, text: str, port: int) -> tuple[str, int]:
    """Return host and port of HOST, HOST:PORT or [ADDRESS]:PORT."""
    from stepdiag.daq.links.ports.address import host_and_port

    found = host_and_port(text, port)
    if found is None:
        raise UsageError(option, expected="HOST, HOST:PORT or [ADDRESS]:PORT", found=repr(text))
    return found


def _refuse(option: str, **given: object) -> None:
    """Raise UsageError for options that mean nothing beside another."""
    names = [f"--{name}" for name, value in given.items() if value]
    if names:
        raise UsageError(option, expected=f"{option} without {' and '.join(names)}", found="both")
