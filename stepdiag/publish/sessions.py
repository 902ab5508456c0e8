"""What a client of the OPC UA server may have: sessions, subscriptions and items by number and size, and no more guesses at a password.

What can grow is counted where it is asked for, and refused in the words of the protocol; nobody touches what belongs to another session.
"""

import asyncio
import math
import secrets
from collections.abc import Callable, Iterable
from typing import Any

import structlog
from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.ua import ua_binary
from asyncua.ua.uaerrors import UaStatusCodeError

from stepdiag.page.security import Guesses
from stepdiag.publish.gate import ASKING, LONGEST_CHUNK, MOST_CONNECTIONS, Doors, Peer

LONGEST_MESSAGE, MOST_CHUNKS = 4 * LONGEST_CHUNK, 8
"""Bytes and chunks of a request: a few hundred times as much comes of it in memory."""
MOST_SESSIONS = MOST_CONNECTIONS
SESSION_S, ACTIVATION_S = 120.0, 15.0
"""How long a session outlives its connection, and how long a connection may be without a session that is let in."""
MOST_OPERATIONS, MOST_CALLS = 1_000, 20
"""Of one request: nodes to read, to browse, to look for; methods to call."""
LONGEST_ANSWER, MOST_REFERENCES = 4_000_000, 20_000
"""Bytes that are read, and references that are browsed, in one request."""
MOST_SUBSCRIPTIONS, MOST_OF_A_SESSION = 200, 20
MOST_ITEMS, MOST_ITEM_BYTES, LONGEST_ITEM = 2_000, 1_000_000, 8_192
"""Monitored items of all clients, the bytes they were asked for with, and those of one. One address has half of each at most."""
LONGEST_QUEUE, MOST_UNACKNOWLEDGED = 10, 10
SHORTEST_INTERVAL_MS, LONGEST_INTERVAL_MS = 200.0, 3_600_000.0
"""Between two messages of a subscription: the survey is not looked at more often."""
_LIMITS = {
    "MaxNodesPerRead": MOST_OPERATIONS, "MaxNodesPerBrowse": MOST_OPERATIONS, "MaxMonitoredItemsPerCall": MOST_OPERATIONS,
    "MaxNodesPerTranslateBrowsePathsToNodeIds": MOST_OPERATIONS, "MaxNodesPerMethodCall": MOST_CALLS,
}  # fmt: skip

_log = structlog.get_logger("publish")


class BoundedServer(InternalServer):  # type: ignore[misc]  # the library is untyped
    """The library's server with limits for all that clients may open."""

    def __init__(self, user_manager: Any, doors: Doors) -> None:
        super().__init__(user_manager=user_manager)
        self._doors = doors
        self._sessions: dict[Any, BoundedSession] = {}
        self._guesses = Guesses(lambda address, count: _log.warning("opcua-password-guessed", address=address, count=count))
        self.items: dict[tuple[int, int], int] = {}
        """Bytes that each monitored item was asked for with, by subscription and item."""
        self.hosts: dict[int, str] = {}
        """The address that each subscription was made from."""
        self._closing: set[asyncio.Task[None]] = set()
        self.max_connections = MOST_CONNECTIONS
        self.max_pending_activation_seconds = ACTIVATION_S
        self.max_session_timeout_ms = SESSION_S * 1e3
        self.max_subscriptions = MOST_SUBSCRIPTIONS
        self.max_monitored_item_queue_size = LONGEST_QUEUE
        self.max_unacked_messages_per_subscription = MOST_UNACKNOWLEDGED

    def create_session(self, name: Any, user: Any = None, external: bool = False) -> InternalSession:  # noqa: ARG002
        """Return a session for a connection, whose address is its name. Raises ServiceError for a second one, and for too many."""
        if any(each.name == name for each in self._sessions.values()):
            raise ServiceError(ua.StatusCodes.BadTooManySessions)
        host = str(name[0])
        if (scope := self._short(host, MOST_SESSIONS, self._sessions_of)) is not None:
            for each in self._gone(scope):
                self.unregister_external_session(each)  # at once, the rest in a turn of its own
                self._closing.add(task := asyncio.get_running_loop().create_task(each.close_session()))
                task.add_done_callback(self._closing.discard)
            if self._short(host, MOST_SESSIONS, self._sessions_of) is not None:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return BoundedSession(self, self.aspace, self.subscription_service, name, external=external)

    def register_external_session(self, session: InternalSession) -> None:
        """Keep a session, under a name that nobody guesses."""
        session.auth_token = ua.NodeId(secrets.token_bytes(32), 0)
        self._sessions[session.auth_token] = session
        super().register_external_session(session)

    def unregister_external_session(self, session: InternalSession) -> None:
        """Forget a session."""
        self._sessions.pop(session.auth_token, None)
        super().unregister_external_session(session)

    def register_server(self, server: Any, conf: Any = None) -> None:  # noqa: ARG002
        """Refuse: this is no directory of servers, and whoever asks has no session."""
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def wrong(self, host: str) -> None:
        """Count a wrong password of an address, and have all answers to it come late: a guess may be sent over any connection."""
        self._doors.hold(host, self._guesses.wrong(host))

    def right(self, host: str) -> None:
        """Forget the wrong ones of an address."""
        self._guesses.right(host)

    async def room_for_subscription(self, host: str) -> None:
        """Raise ServiceError where there are too many subscriptions, of all or of an address, by clients that are still there."""
        await self._room(host, MOST_SUBSCRIPTIONS, self._subscriptions_of, ua.StatusCodes.BadTooManySubscriptions)

    async def room_for_items(self, host: str, sizes: list[int]) -> None:
        """Raise ServiceError where so many more items, asked for with so many bytes, are too many."""
        refusal = ua.StatusCodes.BadTooManyMonitoredItems
        await self._room(host, MOST_ITEMS, lambda of: len(self._items_of(of)) + len(sizes) - 1, refusal)
        await self._room(host, MOST_ITEM_BYTES, lambda of: sum(self._items_of(of)) + sum(sizes) - 1, refusal)

    async def _room(self, host: str, most: int, count: Callable[[str | None], int], refusal: int) -> None:
        if (scope := self._short(host, most, count)) is not None:
            await self._let_go(scope)
            if self._short(host, most, count) is not None:
                raise ServiceError(refusal)

    def _short(self, host: str, most: int, count: Callable[[str | None], int]) -> tuple[str | None] | None:
        """Return of whom there is too much for one more: of this address, or of all (None)."""
        if count(host) >= most // 2:
            return (host,)
        return (None,) if count(None) >= most else None

    def _sessions_of(self, host: str | None) -> int:
        return sum(host in (None, each.peer[0]) for each in self._sessions.values())

    def _subscriptions_of(self, host: str | None) -> int:
        return sum(host in (None, self.hosts.get(number)) for number in self.subscription_service.subscriptions)

    def _items_of(self, host: str | None) -> list[int]:
        """Return the sizes; forget what belongs to subscriptions that are gone."""
        alive = self.subscription_service.subscriptions
        self.hosts = {number: each for number, each in self.hosts.items() if number in alive}
        self.items = {key: size for key, size in self.items.items() if key[0] in alive}
        return [size for key, size in self.items.items() if host in (None, self.hosts.get(key[0]))]

    def _gone(self, scope: tuple[str | None]) -> "list[BoundedSession]":
        """Return the sessions whose connection is gone."""
        return [each for each in self._sessions.values() if scope[0] in (None, each.peer[0]) and each.peer not in self._doors]

    async def _let_go(self, scope: tuple[str | None]) -> None:
        """Close sessions whose connection is gone, and end subscriptions that their session has left behind."""
        for each in self._gone(scope):
            await each.close_session()
        known = {each.session_id for each in self._sessions.values()}
        alive = self.subscription_service.subscriptions.items()
        left = [number for number, each in alive if each.session_id not in known and scope[0] in (None, self.hosts.get(number))]
        await self.subscription_service.delete_subscriptions(left)


class BoundedSession(InternalSession):  # type: ignore[misc]
    """A session that asks for so much at most, and touches nothing but its own."""

    iserver: BoundedServer

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.peer: Peer = (str(self.name[0]), int(self.name[1]))
        """The connection that it is used over."""

    def activate_session(self, params: Any, peer_certificate: Any) -> Any:
        """Let a user in. Raises ServiceError for a wrong password, which is counted and answered late."""
        named = isinstance(params.UserIdentityToken, ua.UserNameIdentityToken)
        try:
            done = super().activate_session(params, peer_certificate)
        except (ServiceError, UaStatusCodeError):
            if named:
                self.iserver.wrong(ASKING.get()[0])
            raise
        self.peer = ASKING.get()
        if named:
            self.iserver.right(self.peer[0])
        return done

    async def read(self, params: Any) -> Any:
        """Read so many nodes, and so many bytes."""
        _at_most(params.NodesToRead, MOST_OPERATIONS)
        found = await super().read(params)
        size = 0
        for each in found:
            size += len(ua_binary.struct_to_binary(each))
            if size > LONGEST_ANSWER:
                raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return found

    async def browse(self, params: Any) -> Any:
        """Browse so many nodes, and so many references."""
        _at_most(params.NodesToBrowse, MOST_OPERATIONS)
        wanted, found, count = params.NodesToBrowse, [], 0
        for each in wanted:
            params.NodesToBrowse = [each]
            found += await super().browse(params)
            count += len(found[-1].References or ())
            if count > MOST_REFERENCES:
                raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return found

    async def translate_browsepaths_to_nodeids(self, params: Any) -> Any:
        """Look for so many nodes."""
        _at_most(params, MOST_OPERATIONS)
        return await super().translate_browsepaths_to_nodeids(params)

    async def call(self, params: Any) -> Any:
        """Call so many methods."""
        _at_most(params, MOST_CALLS)
        return await super().call(params)

    async def history_read(self, params: Any) -> Any:  # noqa: ARG002
        """Refuse: nothing is kept of what was."""
        raise ServiceError(ua.StatusCodes.BadHistoryOperationUnsupported)

    async def create_subscription(self, params: Any, callback: Callable[..., Any], request_callback: Any = None) -> Any:
        """Subscribe, not too often and not to be informed too often."""
        if len(self._own()) >= MOST_OF_A_SESSION:
            raise ServiceError(ua.StatusCodes.BadTooManySubscriptions)
        asked = params.RequestedPublishingInterval
        params.RequestedPublishingInterval = min(max(asked, SHORTEST_INTERVAL_MS), LONGEST_INTERVAL_MS) if math.isfinite(asked) else 1e3
        await self.iserver.room_for_subscription(self.peer[0])
        done = await super().create_subscription(params, callback, request_callback)
        self.iserver.hosts[done.SubscriptionId] = self.peer[0]
        return done

    async def create_monitored_items(self, params: Any) -> Any:
        """Have so many values watched, asked for in so many bytes."""
        self._require_own(params.SubscriptionId)
        _at_most(params.ItemsToCreate, MOST_OPERATIONS)
        sizes = list(map(_size, params.ItemsToCreate))
        await self.iserver.room_for_items(self.iserver.hosts[params.SubscriptionId], sizes)
        done = await super().create_monitored_items(params)
        for each, size in zip(done, sizes, strict=True):
            if each.StatusCode.is_good():
                self.iserver.items[params.SubscriptionId, each.MonitoredItemId] = size
        return done

    async def modify_monitored_items(self, params: Any) -> Any:
        """Change how values are watched, within the same limits."""
        self._require_own(params.SubscriptionId)
        _at_most(params.ItemsToModify, MOST_OPERATIONS)
        for each in params.ItemsToModify:
            key, size = (params.SubscriptionId, each.MonitoredItemId), _size(each)
            if key in self.iserver.items:
                self.iserver.items[key] = size
            each.RequestedParameters.QueueSize = min(max(each.RequestedParameters.QueueSize, 1), LONGEST_QUEUE)
        await self.iserver.room_for_items(self.iserver.hosts[params.SubscriptionId], [])
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(self, params: Any) -> Any:
        """Watch values no more."""
        self._require_own(params.SubscriptionId)
        done = await super().delete_monitored_items(params)
        for number in params.MonitoredItemIds:
            self.iserver.items.pop((params.SubscriptionId, number), None)
        return done

    async def set_monitoring_mode(self, params: Any) -> Any:
        """Watch values again, or not for a while."""
        self._require_own(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: Any) -> Any:
        """Take an answer, or none for a while."""
        params.SubscriptionIds = self._own_of(params.SubscriptionIds)
        return await super().set_publishing_mode(params)

    async def delete_subscriptions(self, ids: Any) -> Any:
        """End subscriptions."""
        return await super().delete_subscriptions(self._own_of(ids))

    async def transfer_subscriptions(self, params: Any, callback: Callable[..., Any]) -> Any:
        """Take over subscriptions of one's own, or of a session before it from the same address."""
        alive = self.subscription_service.subscriptions
        here = {each.session_id for each in self.iserver._sessions.values() if each.peer[0] == self.peer[0]}  # noqa: SLF001
        params.SubscriptionIds = [each if each in alive and alive[each].session_id in here else 0 for each in params.SubscriptionIds]
        return await super().transfer_subscriptions(params, callback)

    def publish(self, acks: Any = None) -> Any:
        """Take what was acknowledged."""
        for each, own in zip(acks or [], self._own_of([each.SubscriptionId for each in acks or []]), strict=True):
            each.SubscriptionId = own
        return super().publish(acks)

    def republish(self, params: Any) -> Any:
        """Return a message again."""
        self._require_own(params.SubscriptionId)
        return super().republish(params)

    def _own(self) -> set[int]:
        return {number for number, each in self.subscription_service.subscriptions.items() if each.session_id == self.session_id}

    def _own_of(self, numbers: Iterable[int]) -> list[int]:
        """Return the numbers with 0, which is nobody's, for those of others."""
        own = self._own()
        return [each if each in own else 0 for each in numbers]

    def _require_own(self, number: int) -> None:
        if number not in self._own():
            raise ServiceError(ua.StatusCodes.BadSubscriptionIdInvalid)


def bounded(users: Any, doors: Doors) -> Server:
    """Return a server that is not started, within these limits."""
    server = Server(iserver=BoundedServer(users, doors))
    server.limits = TransportLimits(LONGEST_CHUNK, LONGEST_CHUNK, MOST_CHUNKS, LONGEST_MESSAGE)
    ua_binary.unpack_uatype_array = _array
    return server


async def announce_limits(server: Server) -> None:
    """Tell clients what they may ask for at once, which those that are well made keep to."""
    for name, most in _LIMITS.items():
        node = server.get_node(getattr(ua.ObjectIds, f"Server_ServerCapabilities_OperationLimits_{name}"))
        await node.write_value(most, ua.VariantType.UInt32)


def _at_most(asked: Any, most: int) -> None:
    if len(asked or ()) > most:
        raise ServiceError(ua.StatusCodes.BadTooManyOperations)


def _size(item: Any) -> int:
    """Return the bytes that an item is asked for with. Raises ServiceError for too many."""
    size = len(ua_binary.struct_to_binary(item))
    if size > LONGEST_ITEM:
        raise ServiceError(ua.StatusCodes.BadRequestTooLarge)
    return size


_unpacked = ua_binary.unpack_uatype_array


def _array(kind: Any, data: Any) -> Any:
    """Unpack an array as the library does, but none of nothing: two billion elements of it would fit five bytes."""
    if kind is ua.VariantType.Null:
        raise ua.UaError("an array of nothing")
    return _unpacked(kind, data)
