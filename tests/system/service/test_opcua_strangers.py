"""`stepdiag publish --opcua` among strangers: the library's limits hold, the process has a
gigabyte, and the next client is served."""

import asyncio
import socket
import struct
import time
from contextlib import suppress
from pathlib import Path

import pytest
from asyncua import Client, ua

from stepdiag.page.security import DELAY_S
from stepdiag.publish import opcua
from testkit.running.brokers import PATIENCE_S
from testkit.running.opcua import MODEL, NOW, Serving, prepared

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

USER, PASSWORD = "mes", "not-to-be-guessed"
MEMORY_KB = 1_100_000
"""The gigabyte of data that the process has, and its program."""


@pytest.fixture(scope="module")
def serving(tmp_path_factory):
    with Serving(prepared(tmp_path_factory.mktemp("survey")), "--plain") as running:
        yield running
        assert running.process.poll() is None, running.said


@pytest.fixture(autouse=True)
def unharmed(serving):
    """Whatever was sent: the next client is served."""
    yield
    asyncio.run(honest(serving))
    lines = Path(f"/proc/{serving.process.pid}/status").read_text().splitlines()
    assert (
        next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) < MEMORY_KB
    )


async def honest(serving, user="", password=""):
    """Come, read the latest result, go; wait for a place where strangers have them all."""
    async with asyncio.timeout(2 * PATIENCE_S):
        while True:
            client = comer(serving)
            client.set_user(user)
            client.set_password(password)
            try:
                async with client:
                    own, index = [
                        await client.get_namespace_index(each)
                        for each in ("urn:stepdiag:publish", MODEL)
                    ]
                    names = [
                        await each.read_browse_name()
                        for each in await client.nodes.objects.get_children()
                    ]
                    path = [
                        next(each for each in names if each.NamespaceIndex == own),
                        f"{index}:ResultManagement",
                    ]
                    management = await client.nodes.objects.get_child(path)
                    assert (await management.call_method(f"{index}:GetLatestResult", NOW))[
                        2
                    ] == 0
                return
            except (ConnectionError, TimeoutError, ua.UaError) as error:
                if isinstance(error, ua.uaerrors.BadUserAccessDenied):
                    raise
                await asyncio.sleep(0.2)


def comer(serving):
    return Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)


def connected(serving):
    return socket.create_connection(
        ("127.0.0.1", int(serving.url.split("/")[2].rpartition(":")[2])), timeout=PATIENCE_S
    )


def closed(guest):
    """Return whether the other side has closed a connection, or does so soon."""
    try:
        while guest.recv(65536):
            pass
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


def hello(buffers=65535):
    body = struct.pack("<IIIII", 0, buffers, buffers, 0, 0) + struct.pack("<i", 0)
    return b"HELF" + struct.pack("<I", 8 + len(body)) + body


WRONG = [
    b"",
    hello(),
    b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
    b"MSGF" + struct.pack("<I", 100) + bytes(92),
    b"HELF" + struct.pack("<I", 0xFFFFFFFF) + bytes(100_000),
    hello() + b"MSGF" + struct.pack("<I", 0xFFFFFFFF) + bytes(100_000),
    hello() + b"ACKF" + struct.pack("<IIIIII", 28, 0, 65535, 65535, 0, 0),
    hello(buffers=30),
    b"HELF" + struct.pack("<I", 3),
]


def test_a_connection_without_a_session_is_closed_whatever_it_sends(serving):
    guests = [connected(serving) for _ in WRONG]
    for guest, sent in zip(guests, WRONG, strict=True):
        with suppress(ConnectionError):
            guest.sendall(sent)
    for guest in guests:
        with guest:
            assert closed(guest)


def test_connections_are_counted(serving):
    guests = [connected(serving) for _ in range(opcua.MOST_CONNECTIONS + 20)]
    try:
        answered = 0
        for guest in guests:
            with suppress(ConnectionError):
                guest.sendall(hello())
                answered += bool(guest.recv(64))
        assert 0 < answered <= opcua.MOST_CONNECTIONS
    finally:
        for guest in guests:
            guest.close()


def test_a_message_that_is_too_long_is_not_answered(serving):
    async def run():
        async with comer(serving) as client:
            node = client.nodes.server.nodeid
            huge = ua.ReadParameters(
                NodesToRead=[
                    ua.ReadValueId(NodeId=node, IndexRange="0" * 2 * opcua.LONGEST_MESSAGE)
                ]
            )
            with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
                await asyncio.wait_for(client.uaclient.read(huge), 5)

    asyncio.run(run())


def test_what_unpacks_to_more_than_the_process_has_is_an_error(serving, monkeypatch):
    """Two billion elements of nothing fit five bytes. The limit of the process ends the request,
    and the memory is given back."""
    empty, nothing = b"\x0c" + struct.pack("<i", 0), b"\x80" + struct.pack("<i", 2**31 - 1)

    async def run():
        async with comer(serving) as client:
            transport = client.uaclient.protocol.transport
            write = transport.write
            monkeypatch.setattr(
                transport, "write", lambda data: write(nothing.join(data.rsplit(empty, 1)))
            )
            asked = ua.CallMethodRequest(
                ObjectId=ua.NodeId(1), MethodId=ua.NodeId(2), InputArguments=[ua.Variant("")]
            )
            with pytest.raises(ua.uaerrors.BadInternalError):
                await client.uaclient.call([asked])
            monkeypatch.undo()

    asyncio.run(run())


def test_subscriptions_are_counted_and_what_is_ended_makes_room(serving):
    async def run():
        async with comer(serving) as client:
            first, *_ = [
                await client.create_subscription(60_000, None)
                for _ in range(opcua.MOST_SUBSCRIPTIONS)
            ]
            with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
                await client.create_subscription(60_000, None)
            await first.delete()
            await client.create_subscription(60_000, None)

    asyncio.run(run())


def test_wrong_passwords_are_answered_late_and_ten_of_them_are_a_warning(serving):
    """Two a second over however many connections; the right one comes in all the same."""
    survey = prepared(serving.folder / "guessed")
    secret = survey.parent / "mes.password"
    secret.touch(0o600)
    secret.write_text(PASSWORD)

    async def guess(running):
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await honest(running, USER, "wrong")

    async def guesses(running):
        await asyncio.gather(*(guess(running) for _ in range(10)))

    with Serving(
        survey, "--plain", "--user", USER, "--password-file", secret.name
    ) as running:
        begun = time.monotonic()
        asyncio.run(guesses(running))
        assert time.monotonic() - begun >= 10 * DELAY_S
        assert '"event":"opcua-password-guessed"' in running.said.replace(" ", "")
        asyncio.run(honest(running, USER, PASSWORD))
        assert running.said.count("opcua-password-guessed") == 1
        assert PASSWORD not in running.said
