"""`stepdiag publish --opcua` among strangers: what they open is counted, what they send is measured, and guesses are answered late."""

import asyncio
import socket
import struct
import time
from contextlib import suppress
from pathlib import Path

import pytest
from asyncua import Client, ua

from stepdiag.publish import gate, sessions
from testkit.running.brokers import PATIENCE_S
from testkit.running.opcua import MODEL, NOW, Serving, prepared

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

USER, PASSWORD = "mes", "not-to-be-guessed"
HURRIED = """
from stepdiag.__main__ import main
from stepdiag.page import security
from stepdiag.publish import gate
gate.FETCH_S, security.DELAY_S = 10.0, 0.1
main()
"""
"""The server, but that it waits less long for who fetches nothing or guesses; who comes from a busy computer must be able to fetch."""
MEMORY_KB = 150_000
"""What all of these attacks together may take, beside what one honest client takes."""


@pytest.fixture(scope="module")
def serving(tmp_path_factory):
    with Serving(prepared(tmp_path_factory.mktemp("survey")), "--plain", program=("-c", HURRIED)) as running:
        asyncio.run(honest(running))
        running.before_kb = most_memory_kb(running)
        yield running
        assert running.process.poll() is None, running.said


@pytest.fixture(autouse=True)
def unharmed(serving):
    """Whatever was done: the next client is served, and memory has hardly grown."""
    yield
    asyncio.run(honest(serving))
    assert most_memory_kb(serving) < serving.before_kb + MEMORY_KB


def most_memory_kb(serving):
    lines = Path(f"/proc/{serving.process.pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


async def honest(serving, user="", password=""):
    """Come, read the latest result, go; wait for a place where strangers have them all."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            client = Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)
            client.set_user(user)
            client.set_password(password)
            try:
                async with client:
                    index = await client.get_namespace_index(MODEL)
                    management = await client.nodes.objects.get_child([*(await machine_of(client)), f"{index}:ResultManagement"])
                    assert (await management.call_method(f"{index}:GetLatestResult", NOW))[2] == 0
                return
            except (ConnectionError, TimeoutError, ua.UaError) as error:
                if isinstance(error, ua.uaerrors.BadUserAccessDenied):
                    raise
                await asyncio.sleep(0.2)


async def machine_of(client):
    own = await client.get_namespace_index("urn:stepdiag:publish")
    return [name for each in await client.nodes.objects.get_children() if (name := await each.read_browse_name()).NamespaceIndex == own]


async def results_of(client):
    index = await client.get_namespace_index(MODEL)
    folder = await client.nodes.objects.get_child([*(await machine_of(client)), f"{index}:ResultManagement", f"{index}:Results"])
    return await folder.get_children()


def connected(serving):
    return socket.create_connection(("127.0.0.1", port_of(serving)), timeout=PATIENCE_S)


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


@pytest.mark.parametrize(
    "told",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"MSGF" + struct.pack("<I", 100) + bytes(92),
        b"HELF" + struct.pack("<I", 0xFFFFFFFF) + bytes(100_000),
        hello() + b"MSGF" + struct.pack("<I", 0xFFFFFFFF) + bytes(100_000),
        hello() + b"ACKF" + struct.pack("<IIIIII", 28, 0, 65535, 65535, 0, 0),
        hello() + hello(),
        hello(buffers=30),
        b"HELF" + struct.pack("<I", 3),
    ],
    ids=["http", "no-hello", "endless-hello", "endless-message", "word-of-a-server", "hello-twice", "buffers-of-nothing", "no-length"],
)
def test_what_is_no_message_of_a_client_ends_the_connection(serving, told):
    with connected(serving) as guest:
        with suppress(ConnectionError):
            guest.sendall(told)
        assert closed(guest)


def test_one_address_takes_half_of_the_places(serving):
    guests = [connected(serving) for _ in range(gate.MOST_CONNECTIONS + 20)]
    try:
        for guest in guests:
            with suppress(ConnectionError):
                guest.sendall(hello())
        answered = 0
        for guest in guests:
            with suppress(ConnectionError):
                answered += bool(guest.recv(64))
        assert 0 < answered <= gate.MOST_OF_ONE_ADDRESS
    finally:
        for guest in guests:
            guest.close()


def test_who_never_comes_in_is_let_go(serving):
    with connected(serving) as guest:
        guest.sendall(hello())
        guest.settimeout(PATIENCE_S)
        assert closed(guest)


def test_a_connection_has_one_session_and_registers_no_server(serving):
    async def run():
        client = Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)
        await client.connect_socket()
        try:
            await client.send_hello()
            await client.open_secure_channel()
            server = ua.RegisteredServer(ServerUri="urn:evil", ServerNames=[ua.LocalizedText("evil")], DiscoveryUrls=["opc.tcp://evil"])
            with pytest.raises(ua.uaerrors.BadServiceUnsupported):
                await client.uaclient.register_server(server)
            assert [each.ApplicationUri for each in await client.find_servers()] == ["urn:stepdiag"]
            await client.create_session()
            for _ in range(50):
                with pytest.raises(ua.uaerrors.BadTooManySessions):
                    await client.create_session()
        finally:
            client.disconnect_socket()

    asyncio.run(run())


def test_too_much_at_once_is_refused_in_words(serving):
    async def run():
        async with Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S) as client:
            (result,) = (await results_of(client))[:1]
            await client.uaclient.read_attributes([result.nodeid], ua.AttributeIds.Value)
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await client.uaclient.read_attributes([result.nodeid] * (sessions.MOST_OPERATIONS + 1), ua.AttributeIds.DisplayName)
            wanted = ua.BrowseDescription(NodeId=client.nodes.base_object_type.nodeid, ReferenceTypeId=ua.NodeId(ua.ObjectIds.References))
            wanted.BrowseDirection, wanted.ResultMask, wanted.IncludeSubtypes = ua.BrowseDirection.Both, 63, True
            with pytest.raises(ua.uaerrors.BadResponseTooLarge):
                await client.uaclient.browse(ua.BrowseParameters(NodesToBrowse=[wanted] * sessions.MOST_OPERATIONS))
            huge = ua.ReadParameters(NodesToRead=[ua.ReadValueId(NodeId=result.nodeid, IndexRange="0" * 1_000_000)])
            with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
                await asyncio.wait_for(client.uaclient.read(huge), 5)

    asyncio.run(run())


def test_answers_that_nobody_fetches_are_not_piled_up(serving):
    """Ten clients ask for two hundred times two megabytes, and read nothing; each is let go in the end."""

    async def greedy():
        client = Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)
        await client.connect()
        (result,) = (await results_of(client))[:1]
        protocol, asked = client.uaclient.protocol, ua.ReadRequest()
        asked.Parameters.NodesToRead = [ua.ReadValueId(NodeId=result.nodeid, AttributeId=ua.AttributeIds.Value)] * 50
        port = protocol.transport.get_extra_info("sockname")[1]
        assert port in established(serving)
        protocol.transport.pause_reading()
        for _ in range(200):
            protocol._send_request(asked)
        return port, protocol.transport

    async def run():
        transports = dict(await asyncio.gather(*(greedy() for _ in range(10))))
        async with asyncio.timeout(2 * PATIENCE_S):
            while established(serving) & transports.keys():  # noqa: ASYNC110  # of another process
                await asyncio.sleep(0.1)
        for each in transports.values():
            each.abort()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:  # what the library leaves behind
            task.cancel()
        return len(transports)

    assert asyncio.run(run()) == 10


def established(serving):
    """Return the ports of the clients whose connection the server has."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    own = f":{port_of(serving):04X}"
    return {int(row[2].rpartition(":")[2], 16) for row in rows if row[1].endswith(own) and row[3] == "01"}


def port_of(serving):
    return int(serving.url.split("/")[2].rpartition(":")[2])


def test_subscriptions_and_items_are_counted(serving):
    class Ears:
        def datachange_notification(self, *_):
            pass

    async def run():
        async with (
            Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S) as client,
            Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S) as other,
        ):
            first = await client.create_subscription(0.001, Ears())
            revised = (await client.uaclient.modify_subscription(asked_for(first.subscription_id))).RevisedPublishingInterval
            assert revised == sessions.SHORTEST_INTERVAL_MS
            for _ in range(sessions.MOST_OF_A_SESSION - 1):
                await client.create_subscription(1000, Ears())
            with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
                await client.create_subscription(1000, Ears())

            now = client.get_node(ua.ObjectIds.Server_ServerStatus_CurrentTime)
            for _ in range(sessions.MOST_ITEMS // 2 // 500):  # as many as one address has
                await first.subscribe_data_change([now] * 500)
            with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
                await first.subscribe_data_change(now)
            long = ua.ReadValueId(NodeId=now.nodeid, AttributeId=ua.AttributeIds.Value, IndexRange="1" * sessions.LONGEST_ITEM)
            items = [ua.MonitoredItemCreateRequest(ItemToMonitor=long)]
            asked = ua.CreateMonitoredItemsParameters(SubscriptionId=first.subscription_id, ItemsToCreate=items)
            with pytest.raises(ua.uaerrors.BadRequestTooLarge):
                await client.uaclient.create_monitored_items(asked)

            (foreign,) = await other.uaclient.delete_subscriptions([first.subscription_id])
            assert foreign.name == "BadSubscriptionIdInvalid", "nobody ends what another has opened"
            (own,) = await client.uaclient.delete_subscriptions([first.subscription_id])
            assert own.is_good()
            second = await other.create_subscription(1000, Ears())
            await second.subscribe_data_change([now] * 500), "what is ended makes room"

    asyncio.run(run())


class OtherAddress(asyncio.SelectorEventLoop):
    """Connects from another address of this computer."""

    async def create_connection(self, *args, **options):
        return await super().create_connection(*args, **options, local_addr=("127.0.0.2", 0))


def comer(serving):
    return Client(serving.url, timeout=PATIENCE_S, watchdog_intervall=PATIENCE_S)


def test_one_address_keeps_no_other_out(serving):
    """It takes half of the subscriptions and items; who comes from elsewhere has the rest, and so has it what it gave back."""

    async def take(held):
        for _ in range(sessions.MOST_SUBSCRIPTIONS // 2 // sessions.MOST_OF_A_SESSION):
            held.append(client := comer(serving))
            await client.connect()
            opened = [await client.create_subscription(60_000, None) for _ in range(sessions.MOST_OF_A_SESSION)]
        now = client.get_node(ua.ObjectIds.Server_ServerStatus_CurrentTime)
        for _ in range(sessions.MOST_ITEMS // 2 // 500):
            await opened[0].subscribe_data_change([now] * 500)
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await opened[1].subscribe_data_change(now)
        held.append(client := comer(serving))
        await client.connect()
        with pytest.raises(ua.uaerrors.BadTooManySubscriptions):
            await client.create_subscription(60_000, None)

    async def come():
        async with comer(serving) as client:
            subscription = await client.create_subscription(60_000, None)
            await subscription.subscribe_data_change([client.get_node(ua.ObjectIds.Server_ServerStatus_CurrentTime)] * 500)

    with asyncio.Runner() as here, asyncio.Runner(loop_factory=OtherAddress) as elsewhere:
        held = []
        here.run(take(held))
        elsewhere.run(come())
        for client in held:
            here.run(leave(client))
        here.run(come())


def test_sessions_left_behind_make_room(serving):
    """A session with a subscription outlives its connection for two minutes, but not where its place is needed."""

    async def run():
        for _ in range(sessions.MOST_SESSIONS + 5):
            client = comer(serving)
            await client.connect()
            await client.create_subscription(60_000, None)
            await leave(client)

    asyncio.run(run())


async def leave(client):
    """Go without a word."""
    client.uaclient.protocol.transport.abort()
    for task in asyncio.all_tasks() - {asyncio.current_task()}:  # what the library leaves behind
        task.cancel()
    await asyncio.sleep(0)


def asked_for(subscription):
    return ua.ModifySubscriptionParameters(SubscriptionId=subscription, RequestedPublishingInterval=0.001)


def test_wrong_passwords_are_answered_late_and_ten_of_them_are_said(serving):
    """Each later than the one before; who has the right one comes in all the same."""
    survey = prepared(Path(serving.folder / "guessed"))
    secret = survey.parent / "mes.password"
    secret.touch(0o600)
    secret.write_text(PASSWORD)

    async def guess(running):
        begun = time.monotonic()
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await honest(running, USER, "wrong")
        return time.monotonic() - begun

    with Serving(survey, "--plain", "--user", USER, "--password-file", secret.name, program=("-c", HURRIED)) as running:
        for count in range(1, 11):
            assert "opcua-password-guessed" not in running.said
            assert asyncio.run(guess(running)) >= 0.1 * count
        assert '"event":"opcua-password-guessed"' in running.said.replace(" ", "")
        assert '"address":"127.0.0.1"' in running.said.replace(" ", "")
        asyncio.run(honest(running, USER, PASSWORD))
        assert running.said.count("opcua-password-guessed") == 1
        assert PASSWORD not in running.said
