"""Publication to an MQTT broker. Messages are retained, sent at least once after every change, and
sent again after every new connection.

An absent broker is tried again at growing intervals; a refusal by the broker ends the program with
a message. The recording runs in a separate process and continues.
"""

import asyncio
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiomqtt
import msgspec
import structlog
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from stepdiag.base.errors import DataError, DeviceError, UsageError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.survey.models import Survey
from stepdiag.publish.messages import Message, State, Watched, topic_of
from stepdiag.publish.process import stand_back, stopped_by_signal

REFUSALS = {
    "Unsupported protocol version",
    "Client identifier not valid",
    "Bad user name or password",
    "Not authorized",
    "Banned",
}
"""Refusals of a connection by a broker (MQTT 5.0, 3.2.2.2). A broker that refuses for these reasons
also refuses the next connection."""
FIRST_WAIT_S, LONGEST_WAIT_S = 1.0, 60.0
ANSWER_S = 10.0
"""Longest time in s for an answer of the broker."""
QOS = 1
LONGEST_PACKET, MOST_HEARD = 8_192, 65_536
"""Largest size in bytes of one packet, and of all packets between two readings of the survey:
without subscriptions a broker sends only acknowledgements."""
PATIENCE_S = 5.0
"""Longest time in s for the last message at the end of the program."""

_log = structlog.get_logger("publish")


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """Address and account of a broker. ``authority`` is a file of trusted certificates in place of
    those of the operating system; ``secure`` means TLS."""

    host: str
    port: int
    secure: bool = True
    authority: Path | None = None
    user: str | None = None
    password: str | None = None

    @property
    def address(self) -> str:
        return f"{self.host}:{self.port}"


def publish(
    watched: Watched,
    survey: Survey,
    broker: Broker,
    *,
    prefix: str,
    every_s: float,
    once: bool,
) -> None:
    """Send the messages of a survey until SIGTERM or SIGINT, or with ``once`` a single time.

    Raises DeviceError for a refusing broker, with ``once`` also for an absent broker, and
    UsageError for invalid certificates.
    """
    asyncio.run(_Publisher(watched, survey, broker, prefix, every_s).run(once=once))


class _Publisher:
    def __init__(
        self, watched: Watched, survey: Survey, broker: Broker, prefix: str, every_s: float
    ) -> None:
        self._watched, self._broker, self._every_s = watched, broker, every_s
        self._topic: Callable[[Message], str] = lambda message: topic_of(
            message, survey, prefix
        )
        self._tls = _context(broker)
        self._stop = asyncio.Event()
        self._damage = ""

    async def run(self, *, once: bool) -> None:
        self._stop = stopped_by_signal()
        stand_back(self._watched.folder, calls=self._broker.port)
        sending, stopped = (
            asyncio.create_task(self._run(once=once)),
            asyncio.create_task(self._stop.wait()),
        )
        await asyncio.wait({sending, stopped}, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        await asyncio.wait({sending}, timeout=PATIENCE_S)
        if sending.cancel():
            await asyncio.wait({sending})
        else:
            sending.result()

    async def _run(self, *, once: bool) -> None:
        wait_s = FIRST_WAIT_S
        while not self._stop.is_set():
            client = self._client()
            try:
                async with client:
                    wait_s = FIRST_WAIT_S
                    _log.info("broker-connected", address=self._broker.address)
                    await self._send(client, once=once)
            except (aiomqtt.MqttError, MemoryError) as error:
                client.let_go()
                self._judge(error, once=once)
                _log.warning(
                    "broker-away",
                    address=self._broker.address,
                    reason=str(error),
                    next_try_s=wait_s,
                )
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._stop.wait(), wait_s)
                wait_s = min(2 * wait_s, LONGEST_WAIT_S)

    def _client(self) -> "_Client":
        will = self._watched.online(online=False)
        broker = self._broker
        return _Client(
            broker.host,
            broker.port,
            username=broker.user,
            password=broker.password,
            tls_context=self._tls,
            timeout=ANSWER_S,
            keepalive=20,
            will=aiomqtt.Will(
                self._topic(will), msgspec.json.encode(will), qos=QOS, retain=True
            ),
        )

    async def _send(self, client: "_Client", *, once: bool) -> None:
        sent: dict[str, bytes] = {}
        if once:
            state, *others = self._watched.now()
            for topic in (state, *others):
                await self._put(client, topic, sent)
            if isinstance(state, State) and state.damage:  # no other code uses this task
                raise DataError(
                    self._watched.name,
                    expected=message("readable-result"),
                    found=state.damage,
                )
            self._stop.set()
            return
        await self._put(client, self._watched.online(online=True), sent)
        lost = asyncio.create_task(_until_lost(client))
        stopped = asyncio.create_task(self._stop.wait())
        try:
            while not self._stop.is_set():
                client.heard = 0
                await self._send_new(client, sent)
                await asyncio.wait(
                    {lost, stopped},
                    timeout=self._every_s,
                    return_when=asyncio.FIRST_COMPLETED,
                )
                if lost.done():
                    lost.result()
            await self._put(client, self._watched.online(online=False), sent)
        finally:
            for task in (lost, stopped):
                task.cancel()
            await asyncio.gather(lost, stopped, return_exceptions=True)

    async def _send_new(self, client: aiomqtt.Client, sent: dict[str, bytes]) -> None:
        for topic in self._watched.now():
            if isinstance(topic, State) and topic.damage != self._damage:
                self._damage = topic.damage
                if self._damage:
                    _log.warning("survey-unreadable", reason=self._damage)
            await self._put(client, topic, sent)

    async def _put(
        self, client: aiomqtt.Client, message: Message, sent: dict[str, bytes]
    ) -> None:
        topic, payload = self._topic(message), msgspec.json.encode(message)
        if sent.get(topic) != payload:
            await client.publish(topic, payload, qos=QOS, retain=True)
            sent[topic] = payload

    def _judge(self, error: Exception, *, once: bool) -> None:
        code = error.rc if isinstance(error, aiomqtt.MqttCodeError) else None
        refused = isinstance(code, ReasonCode) and code.getName() in REFUSALS
        untrusted = "CERTIFICATE_VERIFY_FAILED" in str(error)
        if refused or untrusted or once:
            remedy = message("see-broker-log") if refused else ""
            if untrusted:
                remedy = message("name-authority")
            raise DeviceError(
                self._broker.address,
                expected=message("willing-broker"),
                found=str(error),
                remedy=remedy,
            )


class _Client(aiomqtt.Client):
    """An MQTT client that limits the received bytes and accepts no messages: the library stores
    every packet of a broker, up to 268 MB each."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.heard = 0
        paho: Any = self._client
        self._receive = paho._sock_recv  # noqa: SLF001  # it has no other place where a limit could stand
        paho._sock_recv, paho._handle_publish = self._received, self._refused  # noqa: SLF001
        # The library would first bind its socket to a port, which `stepdiag.walls.confine` forbids.
        paho._create_socket_connection = lambda: socket.create_connection(  # noqa: SLF001
            (paho.host, paho.port), timeout=paho.connect_timeout
        )

    def let_go(self) -> None:
        """Close the open connection: after an unexpected packet, the library leaves the connection
        open and continues to read."""
        sock = self._client.socket()
        if sock is not None and sock.fileno() >= 0:
            loop = asyncio.get_running_loop()
            loop.remove_reader(sock.fileno())
            loop.remove_writer(sock.fileno())
            sock.close()

    def _received(self, size: int) -> bytes:
        if size > LONGEST_PACKET or self.heard > MOST_HEARD:
            raise ConnectionError(message("broker-sends-too-much"))
        data: bytes = self._receive(size)
        self.heard += len(data)
        return data

    def _refused(self) -> MQTTErrorCode:
        return MQTTErrorCode.MQTT_ERR_PROTOCOL


async def _until_lost(client: aiomqtt.Client) -> None:
    async for _ in client.messages:  # the client subscribes to no topic
        pass


def _context(broker: Broker) -> ssl.SSLContext | None:
    if not broker.secure:
        return None
    try:
        return ssl.create_default_context(
            cafile=None if broker.authority is None else str(broker.authority)
        )
    except OSError as error:  # ssl.SSLError is an OSError
        raise UsageError(
            str(broker.authority),
            expected=message("pem-certificates"),
            found=system_words(error),
        ) from error
