"""``stepdiag publish``: state, findings and result of a survey for other programs (extras
``stepdiag[mqtt]``, ``stepdiag[opcua]``)."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.cli.fleet import extra_needed

if TYPE_CHECKING:
    from stepdiag.publish.mqtt import Broker
    from stepdiag.publish.opcua import Endpoint

PORT, SECURE_PORT, OPCUA_PORT = 1883, 8883, 4840


def register(app: typer.Typer) -> None:
    app.command("publish")(publish)


def publish(
    file: Annotated[Path | None, typer.Argument()] = None,
    broker: str = "",
    opcua: str = "",
    ca: Annotated[Path | None, typer.Option("--ca")] = None,
    certificate: Path | None = None,
    key: str = "",
    plain: Annotated[bool, typer.Option("--plain")] = False,
    user: str = "",
    password_file: Annotated[str, typer.Option("--password-file")] = "",
    topic: str = "stepdiag",
    every: Annotated[float, typer.Option(min=0.2, max=3600)] = 5.0,
    once: Annotated[bool, typer.Option("--once")] = False,
    schema: Annotated[bool, typer.Option("--schema")] = False,
) -> None:
    """Send a survey to an MQTT broker, or serve it by OPC UA."""
    from stepdiag.publish.messages import schemas

    if schema:
        typer.echo(json.dumps(schemas(), indent=2))
        return
    if file is None or bool(broker) == bool(opcua):
        found = message("both" if broker else "neither")
        if file is None:
            found = message("no-survey-file")
        raise UsageError(
            "publish",
            expected=message(
                "survey-file-and",
                what=message(
                    "either-option",
                    one="--broker HOST[:PORT]",
                    other="--opcua ADDRESS[:PORT]",
                ),
            ),
            found=found,
        )
    with extra_needed("mqtt" if broker else "opcua"):
        if broker:
            from stepdiag.publish import mqtt
        else:
            from stepdiag.publish import opcua as server
    from stepdiag.daemon.journal import configure
    from stepdiag.daq.survey.file import load_survey
    from stepdiag.publish.messages import Watched

    if any(letter in topic for letter in "+#\0") or not topic.strip("/"):
        raise UsageError("--topic", expected=message("plain-topic"), found=repr(topic))
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


def _broker(
    file: Path, address: str, ca: Path | None, user: str, password_file: str, *, plain: bool
) -> "Broker":
    from stepdiag.daq.links.ports.address import require_host_and_port
    from stepdiag.publish.mqtt import Broker

    if plain and ca is not None:
        raise UsageError(
            "--plain",
            expected=message("either-option", one="--ca", other="--plain"),
            found=message("both"),
        )
    host, port = require_host_and_port("--broker", address, PORT if plain else SECURE_PORT)
    known_user, password = _who(
        file, "mqtt", user, password_file, f"broker {host}", host, plain=plain
    )
    return Broker(
        host=host,
        port=port,
        secure=not plain,
        authority=ca,
        user=known_user,
        password=password,
    )


def _endpoint(
    file: Path,
    address: str,
    certificate: Path | None,
    key: str,
    user: str,
    password_file: str,
    *,
    plain: bool,
) -> "Endpoint":
    from stepdiag.daq.links.ports.address import require_host_and_port
    from stepdiag.page.settings import secret_file
    from stepdiag.publish.opcua import Endpoint

    own_key = secret_file(file, "opcua-key", key, "--key")
    own_key = own_key if own_key is not None and own_key.is_file() else None
    complete = certificate is not None and own_key is not None
    if plain == complete or (plain and (certificate is not None or key)):
        none = certificate is None and own_key is None
        found = message("neither") if none else message("one-of-both")
        if plain:
            found = message("both")
        raise UsageError(
            "--opcua",
            expected=message(
                "either-option",
                one=message("option-pair", one="--certificate", other="--key"),
                other="--plain",
            ),
            found=found,
        )
    host, port = require_host_and_port("--opcua", address, OPCUA_PORT)
    known_user, password = _who(
        file, "opcua", user, password_file, f"OPC UA server {host}", host, plain=plain
    )
    if known_user is not None and password is None:
        raise UsageError(
            "--user", expected=message("password-for-user"), found=message("none")
        )
    return Endpoint(
        host=host,
        port=port,
        certificate=certificate,
        key=None if plain else own_key,
        user=known_user,
        password=password,
    )


def _who(
    file: Path, kind: str, user: str, password_file: str, whom: str, host: str, *, plain: bool
) -> tuple[str | None, str | None]:
    from stepdiag.page.settings import is_loopback, secret

    known_user = user or secret(file, f"{kind}-user", "", "--user") or None
    password = secret(file, f"{kind}-password", password_file, "--password-file") or None
    if plain and password is not None and not is_loopback(host):
        remedy = (
            message("without-plain-mqtt")
            if kind == "mqtt"
            else message("without-plain-opcua")
        )
        raise UsageError(
            whom, expected=message("encryption-for-password"), found="--plain", remedy=remedy
        )
    if password is not None and known_user is None:
        raise UsageError(
            whom, expected=message("user-for-password", kind=kind), found=message("none")
        )
    return known_user, password


def _refuse(option: str, **given: object) -> None:
    names = [f"--{name}" for name, value in given.items() if value]
    if names:
        raise UsageError(
            option,
            expected=message("without-options", option=option, others=names),
            found=message("both"),
        )
