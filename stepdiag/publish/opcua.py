"""A read-only OPC UA server with the results, state and findings of one survey
(`stepdiag.publish.station`).

This module uses only the public interface of asyncua. The library limits connections, messages and
subscriptions; the walls of the process and its unit limit all other resources (docs/security.md).
So a client can end this server, but not the recording, which runs in another process.
"""

import asyncio
import gc
import hmac
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog
from asyncua import Server, ua
from asyncua.crypto.permission_rules import User, UserRole

from stepdiag.base.errors import DeviceError, UsageError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.survey.models import Survey
from stepdiag.page.security import DELAY_S, Guesses
from stepdiag.publish.messages import Watched
from stepdiag.publish.process import stand_back, stopped_by_signal
from stepdiag.publish.station import Station

MOST_CONNECTIONS, ACTIVATION_S, SESSION_S = 100, 15.0, 120.0
"""Largest number of connections; longest time in s of a connection without an admitted session;
time in s for which a session outlives its connection."""
LONGEST_MESSAGE, CHUNK = 262_144, 65_535
"""Largest size in bytes of a request, and of one of its chunks: in memory a request needs a few
hundred times as much."""
MOST_SUBSCRIPTIONS, LONGEST_QUEUE, MOST_UNACKNOWLEDGED = 200, 10, 10

_log = structlog.get_logger("publish")


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """Address and security of the server. Without ``certificate`` and ``key`` nothing is encrypted;
    with ``user`` no anonymous client is admitted."""

    host: str
    port: int
    certificate: Path | None = None
    key: Path | None = None
    user: str | None = None
    password: str | None = None

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"opc.tcp://{host}:{self.port}/stepdiag"


def serve(watched: Watched, survey: Survey, endpoint: Endpoint, *, every_s: float) -> None:
    """Serve the survey until SIGTERM or SIGINT. Raises DeviceError for an address that cannot be
    opened, UsageError for an invalid certificate or key."""
    logging.getLogger("asyncua").setLevel(
        logging.CRITICAL
    )  # the library reports every client that leaves early or requests too much
    asyncio.run(_serve(watched, survey, endpoint, every_s))


async def _serve(
    watched: Watched, survey: Survey, endpoint: Endpoint, every_s: float
) -> None:
    stop = stopped_by_signal()
    with _opening(endpoint):  # tried before the address space is built, which takes seconds
        tried = await asyncio.get_running_loop().create_server(
            asyncio.Protocol, endpoint.host, endpoint.port, start_serving=False
        )
        tried.close()
    with _kept():
        server = await _prepared(endpoint)
        station = await Station.made(server, survey, watched)
    with _opening(endpoint):
        await server.start()
    stand_back(watched.folder)
    _log.info("opcua-serves", address=endpoint.url)
    try:
        while not stop.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), every_s)
            await station.write(watched)
    finally:
        await server.stop()


@contextmanager
def _kept() -> Iterator[None]:
    """Create objects without garbage collection, because they live as long as the process and their
    examination takes two fifths of the start."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def _opening(endpoint: Endpoint) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DeviceError(
            endpoint.url,
            expected=message("free-address", address=endpoint.url),
            found=system_words(error),
        ) from error


async def _prepared(endpoint: Endpoint) -> Server:
    secure = endpoint.certificate is not None and endpoint.key is not None
    server = Server(user_manager=_Users(endpoint.user, endpoint.password, secure=secure))
    _limit(server)
    # A wrong file is refused before the address space is built, which takes most of the start.
    for path, load in (
        (endpoint.certificate, server.load_certificate),
        (endpoint.key, server.load_private_key),
    ):
        if path is not None:
            await _loaded(path, load)
    if (
        secure
        and server.iserver.certificate.public_key() != server.iserver.private_key.public_key()
    ):
        raise UsageError(
            str(endpoint.key),
            expected=message("key-of", name=str(endpoint.certificate)),
            found=message("another-one"),
        )
    await server.init()
    server.set_endpoint(endpoint.url)
    server.set_server_name("stepdiag")
    policy = (
        ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt
        if secure
        else ua.SecurityPolicyType.NoSecurity
    )
    server.set_security_policy([policy])
    server.set_identity_tokens(
        [ua.AnonymousIdentityToken if endpoint.user is None else ua.UserNameIdentityToken]
    )
    await server.set_application_uri(_uri_of(server.iserver.certificate) or "urn:stepdiag")
    return server


def _limit(server: Server) -> None:
    inner, wire = server.iserver, server.limits
    inner.max_connections, inner.max_pending_activation_seconds = (
        MOST_CONNECTIONS,
        ACTIVATION_S,
    )
    inner.max_session_timeout_ms, inner.max_subscriptions = (
        SESSION_S * 1e3,
        MOST_SUBSCRIPTIONS,
    )
    inner.max_monitored_item_queue_size, inner.max_unacked_messages_per_subscription = (
        LONGEST_QUEUE,
        MOST_UNACKNOWLEDGED,
    )
    wire.max_message_size, wire.max_chunk_count = (
        LONGEST_MESSAGE,
        2 * LONGEST_MESSAGE // CHUNK,
    )


async def _loaded(path: Path, load: Callable[[Path], Any]) -> None:
    try:
        await load(path)
    except (OSError, ValueError, TypeError) as error:
        why = (
            (error.strerror if isinstance(error, OSError) else None)
            or str(error)
            or type(error).__name__
        )
        remedy = message(
            "command-writes",
            command="openssl req -x509 .. -addext subjectAltName=URI:urn:NAME,DNS:HOST",
        )
        raise UsageError(
            str(path), expected=message("certificate-and-key"), found=why, remedy=remedy
        ) from error


def _uri_of(certificate: Any) -> str:
    if certificate is None:
        return ""
    from cryptography import x509

    with suppress(x509.ExtensionNotFound):
        names = certificate.extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        ).value
        return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")
    return ""


class _Users:
    """Admission of users: every client can read, or only a single user with a password. No client
    can change anything.

    The library opens an unencrypted channel for every client that queries the server's channels,
    and would also open a session over this channel. If the server is encrypted (``secure``), this
    class refuses a session over an unencrypted channel.
    """

    def __init__(self, user: str | None, password: str | None, *, secure: bool) -> None:
        self._user, self._password, self._secure = user, password or "", secure
        self._guesses = Guesses(
            lambda _, count: _log.warning("opcua-password-guessed", count=count)
        )

    def get_user(
        self,
        iserver: Any,  # noqa: ARG002
        username: str | None = None,
        password: Any = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user with a name and a password. Return None for a wrong name or password, and
        for an unencrypted client of an encrypted server."""
        if self._secure and not certificate:
            return None
        if self._user is None:
            return User(role=UserRole.User)
        given = password if isinstance(password, bytes) else str(password or "").encode()
        right = hmac.compare_digest(
            str(username or "").encode(), self._user.encode()
        ) & hmac.compare_digest(given, self._password.encode())
        if right:
            self._guesses.right("")
            return User(role=UserRole.User, name=username)
        self._guesses.wrong("")
        time.sleep(
            DELAY_S
        )  # the whole server waits: two guesses a second, over any number of connections
        return None
