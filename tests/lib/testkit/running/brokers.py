"""A real MQTT broker (mosquitto) on this computer: TLS, one user, nothing kept on disk; and what it
holds, as a newcomer hears it."""

import asyncio
import json
import socket
import ssl
import subprocess
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import aiomqtt

from stepdiag.virtual.base.reserved import reserved_port

USER, PASSWORD = "stepdiag", "not-to-be-guessed"
PATIENCE_S = 180


@dataclass(frozen=True)
class Place:
    """Where a broker is, or will be."""

    folder: Path
    port: int

    @property
    def authority(self):
        return self.folder / "broker.crt"


def prepared(folder):
    """Make certificate, password and settings of a broker; return where it will be."""
    port = reserved_port()
    _run(
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
        "-subj",
        "/CN=localhost",
        "-addext",
        "subjectAltName=DNS:localhost,IP:127.0.0.1",
        "-keyout",
        folder / "broker.key",
        "-out",
        folder / "broker.crt",
    )
    _run("mosquitto_passwd", "-b", "-c", folder / "users", USER, PASSWORD)
    settings = {
        "listener": f"{port} 127.0.0.1",
        "certfile": folder / "broker.crt",
        "keyfile": folder / "broker.key",
        "allow_anonymous": "false",
        "password_file": folder / "users",
        "persistence": "false",
        "user": "root",
    }
    (folder / "broker.conf").write_text(
        "".join(f"{name} {value}\n" for name, value in settings.items())
    )
    return Place(folder, port)


@contextmanager
def running(place):
    """Run the broker; it is ready when this begins."""
    with (place.folder / "broker.log").open("ab") as log:
        broker = subprocess.Popen(
            ["mosquitto", "-c", place.folder / "broker.conf"], stdout=log, stderr=log
        )
    try:
        end = time.monotonic() + PATIENCE_S
        while True:
            with suppress(OSError):
                socket.create_connection(("127.0.0.1", place.port), timeout=5).close()
                break
            assert broker.poll() is None, (place.folder / "broker.log").read_text()
            assert time.monotonic() < end
            time.sleep(0.05)
        yield
    finally:
        broker.terminate()
        broker.wait(PATIENCE_S)


def heard(place, wanted):
    """Return what somebody who has only just come hears, by the last word of its topic, once
    ``wanted`` says that it is right."""
    return asyncio.run(asyncio.wait_for(_heard(place, wanted), PATIENCE_S))


async def _heard(place, wanted):
    context = ssl.create_default_context(cafile=place.authority)
    async with aiomqtt.Client(
        "127.0.0.1",
        place.port,
        username=USER,
        password=PASSWORD,
        tls_context=context,
        timeout=PATIENCE_S,
    ) as client:
        await client.subscribe("#", qos=1)
        held = {}
        async for message in client.messages:
            held[message.topic.value] = json.loads(message.payload)
            if wanted({topic.rpartition("/")[2]: said for topic, said in held.items()}):
                return held
    return {}


def _run(*command):
    subprocess.run([*map(str, command)], capture_output=True, check=True, timeout=60)
