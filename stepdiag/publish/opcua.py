"""A server of OPC UA: results, state and findings of one survey, to be read by anybody who may connect, and changed by nobody.

Results are offered as OPC 40001-101 says: as variables below ``Results``, by ``GetLatestResult`` and ``GetResultById``, and announced by an
event when they are new. The recording runs in a process of its own and knows nothing of this one.
"""

import asyncio
import hmac
import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import structlog
from asyncua import Server, ua
from asyncua.crypto.permission_rules import User, UserRole

from stepdiag.base.conformity import together
from stepdiag.base.errors import DeviceError, UsageError, system_words
from stepdiag.base.messages import message
from stepdiag.daq.survey.models import Survey
from stepdiag.publish.gate import Doors, GatedLoop
from stepdiag.publish.messages import Findings, ResultMessage, State, Watched
from stepdiag.publish.process import stand_back, stopped_by_signal
from stepdiag.publish.result_model import (
    ANYTHING,
    EVENT_TYPE,
    GET_BY_ID,
    GET_LATEST,
    MANAGEMENT_TYPE,
    META,
    NAME_OF_INSTANCE,
    RELEASE,
    RESULT_TYPE,
    Model,
    Nodes,
    add_model,
)  # fmt: skip
from stepdiag.publish.sessions import announce_limits, bounded

OWN_NAMESPACE = "urn:stepdiag:publish"
UNKNOWN = -1
"""The error of a method for a result or a handle that nobody knows; the model leaves what is below 0 to the application."""
MOST_HANDLES = 1000
_MINUTE = "%Y-%m-%d %H:%M UTC"

EVALUATED = {"": "Undefined", "conform": "OK", "not_conform": "NotOK", "not_decidable": "NotDecidable"}
"""The verdict about a machine as OPC 40001-101 names it."""
_log = structlog.get_logger("publish")


@dataclass(frozen=True, slots=True, kw_only=True)
class Endpoint:
    """Where clients connect, and how. Without ``certificate`` and ``key`` nothing is encrypted; with ``user`` nobody comes in nameless."""

    host: str
    port: int
    certificate: Path | None = None
    key: Path | None = None
    user: str | None = None
    password: str | None = None

    @property
    def url(self) -> str:
        """Return the address as clients write it."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"opc.tcp://{host}:{self.port}/stepdiag"


def serve(watched: Watched, survey: Survey, endpoint: Endpoint, *, every_s: float) -> None:
    """Serve until SIGTERM or SIGINT. Raises DeviceError where nobody can listen there, UsageError for a certificate or key that is none."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it tells of every client that leaves early or asks for too much
    doors = Doors()
    with asyncio.Runner(loop_factory=lambda: GatedLoop(doors)) as runner:
        runner.run(_serve(watched, survey, endpoint, every_s, doors))


async def _serve(watched: Watched, survey: Survey, endpoint: Endpoint, every_s: float, doors: Doors) -> None:
    stop = stopped_by_signal()
    server = await _prepared(endpoint, doors)
    station = await Station.made(server, survey)
    for each in watched.history():
        await station.offer(*each, new=False)
    await station.say(watched)
    try:
        await server.start()
    except OSError as error:
        raise DeviceError(endpoint.url, expected=message("free-address", address=endpoint.url), found=system_words(error)) from error
    stand_back(watched.folder)
    _log.info("opcua-serves", address=endpoint.url)
    try:
        while not stop.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), every_s)
            await station.say(watched)
    finally:
        await server.stop()


async def _prepared(endpoint: Endpoint, doors: Doors) -> Server:
    """Return a server that is not started, with its security. Raises UsageError for certificate and key."""
    secure = endpoint.certificate is not None and endpoint.key is not None
    server = bounded(_Users(endpoint.user, endpoint.password, secure=secure), doors)
    # before the address space is built, which takes most of the start: a file that is wrong is refused at once
    for path, load in ((endpoint.certificate, server.load_certificate), (endpoint.key, server.load_private_key)):
        if path is not None:
            await _loaded(path, load)
    if secure and server.iserver.certificate.public_key() != server.iserver.private_key.public_key():
        raise UsageError(str(endpoint.key), expected=message("key-of", name=str(endpoint.certificate)), found=message("another-one"))
    await server.init()
    await announce_limits(server)
    server.set_endpoint(endpoint.url)
    server.set_server_name("stepdiag")
    policy = ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt if secure else ua.SecurityPolicyType.NoSecurity
    server.set_security_policy([policy])
    server.set_identity_tokens([ua.AnonymousIdentityToken if endpoint.user is None else ua.UserNameIdentityToken])
    await server.set_application_uri(_uri_of(server.iserver.certificate) or "urn:stepdiag")
    return server


async def _loaded(path: Path, load: Callable[[Path], Any]) -> None:
    try:
        await load(path)
    except (OSError, ValueError, TypeError) as error:
        why = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
        remedy = message("command-writes", command="openssl req -x509 .. -addext subjectAltName=URI:urn:NAME,DNS:HOST")
        raise UsageError(str(path), expected=message("certificate-and-key"), found=why, remedy=remedy) from error


def _uri_of(certificate: Any) -> str:
    """Return the name of the application in its certificate, which clients hold against what the server says of itself."""
    if certificate is None:
        return ""
    from cryptography import x509

    with suppress(x509.ExtensionNotFound):
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")
    return ""


class _Users:
    """Who may come in: everybody to read, or one user with a password. Nobody may change anything.

    The library lets everybody open a channel in the clear, to ask which ones there are, and a session over it too: a client without a
    certificate has come that way, which an encrypted server (``secure``) refuses here.
    """

    def __init__(self, user: str | None, password: str | None, *, secure: bool) -> None:
        self._user, self._password, self._secure = user, password or "", secure

    def get_user(self, iserver: Any, username: str | None = None, password: Any = None, certificate: Any = None) -> User | None:  # noqa: ARG002
        """Return the user that a name and a password stand for, None where they are wrong, and for who comes in the clear."""
        if self._secure and not certificate:
            return None
        if self._user is None:
            return User(role=UserRole.User)
        given = password if isinstance(password, bytes) else str(password or "").encode()
        right = hmac.compare_digest(str(username or "").encode(), self._user.encode()) & hmac.compare_digest(given, self._password.encode())
        return User(role=UserRole.User, name=username) if right else None


class Station:
    """The machine's object in the address space: its state, findings and results."""

    def __init__(self, server: Server, model: Model, own: int) -> None:
        self._server, self._model, self._own = server, model, own
        self._nodes = Nodes(server, model)
        self._values: dict[str, Any] = {}
        self._results: dict[str, Any] = {}
        self._handles: dict[int, None] = {}
        self._last_handle = 0
        self._round = ""
        self._folder: Any = None
        self._event: Any = None

    @classmethod
    async def made(cls, server: Server, survey: Survey) -> "Station":
        """Put model and object into a server."""
        model = await add_model(server)
        station = cls(server, model, await server.register_namespace(OWN_NAMESPACE))
        await station._build(survey)
        return station

    async def _build(self, survey: Survey) -> None:
        own, model = self._own, self._model
        machine = await self._server.nodes.objects.add_object(own, survey.identity.machine)
        await machine.add_property(own, "Survey", survey.identity.name)
        state = await machine.add_object(own, "State")
        for field in msgspec.structs.fields(State):
            kind = ua.VariantType.Boolean if field.type is bool else ua.VariantType.String
            if field.type in (bool, str) and field.name not in ("machine", "survey"):
                name = field.name.title().replace("_", "")
                self._values[field.name] = await state.add_variable(own, name, False if field.type is bool else "", kind)
        self._values["findings"] = await machine.add_variable(own, "Findings", ua.Variant([], ua.VariantType.String, is_array=True))
        kind = model.id(MANAGEMENT_TYPE)
        management = await self._nodes.add(ua.NodeClass.Object, ua.NodeId(0, own), NAME_OF_INSTANCE, machine.nodeid, 47, kind=kind)
        self._folder = await self._nodes.add(ua.NodeClass.Object, ua.NodeId(0, own), "Results", management.nodeid, 47, kind=ua.NodeId(61))
        for name, answer in ((GET_LATEST, self._latest), (GET_BY_ID, self._by_id), (RELEASE, self._release)):
            self._server.link_method(await self._nodes.method(name, management.nodeid, own=own), answer)
        # the model's own type of event is abstract: what is sent is of a type below it
        event = await self._server.get_node(model.id(EVENT_TYPE)).add_object_type(own, "StepdiagResultReadyEventType")
        self._event = await self._server.get_event_generator(event, management)

    async def say(self, watched: Watched) -> None:
        """Write state and findings as they are now, at one moment and of one round, and offer a result that is new."""
        state, *result = watched.now()
        values = {name: getattr(state, name) for name in self._values if name != "findings"}
        offered: list[tuple[Findings, ResultMessage]] = []
        if result:
            findings, published = result
            assert isinstance(findings, Findings)
            assert isinstance(published, ResultMessage)
            offered = [(findings, published)]
            values["findings"] = [msgspec.json.encode(each).decode() for each in findings.findings]
        elif not values["complete"] or values["round"] != self._round:
            values["findings"] = []  # those of another round, or of a result that is gone, are no findings of this one
        self._round, now = values["round"], datetime.now(UTC)
        for name, value in values.items():
            kind = ua.VariantType.Boolean if isinstance(value, bool) else ua.VariantType.String
            variant = ua.Variant(value, kind, is_array=isinstance(value, list))
            await self._values[name].write_value(ua.DataValue(variant, SourceTimestamp=now, ServerTimestamp=now))
        for findings, published in offered:
            await self.offer(findings, published, new=True)

    async def offer(self, findings: Findings, published: ResultMessage, *, new: bool) -> None:
        """Add a result that is not there yet; say so where it is ``new``."""
        name = result_id(published)
        if name in self._results:
            self._results[name] = self._results.pop(name) if new else self._results[name]  # put back as it was: the latest once more
            return
        meta = self._meta(name, findings, published)
        content = [ua.Variant(msgspec.json.encode(each).decode(), ua.VariantType.String) for each in (published, findings)]
        result = self._model.result(ResultMetaData=meta, ResultContent=content)
        self._results[name] = result
        await self._variable(name, result)
        if new:
            event = self._event.event
            for path, value in (
                ("Result", result),
                ("Result/ResultMetaData", meta),
                *((f"Result/ResultMetaData/{m}", v) for m, v in _members(meta)),
            ):
                event.add_variable(path, *_typed(value))
            await self._event.trigger(message=f"result {name}")
            _log.info("opcua-result", result=name)

    def _meta(self, name: str, findings: Findings, published: ResultMessage) -> Any:
        """Return the meta data: the part is the machine, the job the survey. A calibration without a tolerance is not judged OK or not."""
        wrong = sorted({each.code for each in findings.findings if each.severity == "error"})
        verdict = "not_decidable" if wrong else together(one.verdict for one in published.conformity) if published.conformity else ""
        evaluation = getattr(self._model.evaluation, EVALUATED[verdict])
        begun, ended = _moment(published.begun), _moment(published.ended)
        times = self._model.times(StartTime=begun, EndTime=ended) if begun and ended else None
        details = ua.LocalizedText(", ".join(wrong)) if wrong else None
        return self._model.meta(
            ResultId=name, HasTransferableDataOnFile=False, IsPartial=False, PartId=published.machine, JobId=published.survey,
            CreationTime=ended, ProcessingTimes=times, ResultEvaluation=evaluation, ResultEvaluationDetails=details,
        )  # fmt: skip

    async def _variable(self, name: str, result: Any) -> None:
        model, own, structured = self._model, self._own, ua.ObjectIds.HasStructuredComponent
        free, plain = ua.NodeId(0, own), ua.NodeId(63)
        add, variable = self._nodes.add, ua.NodeClass.Variable
        node = await add(
            variable, free, ua.QualifiedName(name, own), self._folder.nodeid, 47, model.type(-1 - 3008), kind=model.id(RESULT_TYPE)
        )
        content = await add(variable, free, "ResultContent", node.nodeid, structured, ua.NodeId(ANYTHING), kind=plain, array=True)
        meta = await add(variable, free, "ResultMetaData", node.nodeid, structured, model.type(-1 - 3007), kind=plain)
        types = {each.name: each for each in META}
        for member, value in _members(result.ResultMetaData):
            part = await add(variable, free, member, meta.nodeid, structured, model.type(types[member].type), kind=plain)
            await part.write_value(ua.Variant(*_typed(value)))
        await node.write_value(ua.Variant(result, ua.VariantType.ExtensionObject))
        await meta.write_value(ua.Variant(result.ResultMetaData, ua.VariantType.ExtensionObject))
        await content.write_value(ua.Variant(result.ResultContent, ua.VariantType.Variant, is_array=True))

    async def _latest(self, _parent: ua.NodeId, _timeout: ua.Variant) -> list[ua.Variant]:
        return self._given(next(reversed(self._results.values()), None))

    async def _by_id(self, _parent: ua.NodeId, name: ua.Variant, _timeout: ua.Variant) -> list[ua.Variant]:
        return self._given(self._results.get(str(name.Value or "").strip()))

    async def _release(self, _parent: ua.NodeId, handle: ua.Variant) -> list[ua.Variant]:
        known = handle.Value in self._handles
        self._handles.pop(handle.Value, None)
        return [ua.Variant(0 if known else UNKNOWN, ua.VariantType.Int32)]

    def _given(self, result: Any) -> list[ua.Variant]:
        """Return handle, result and error. A handle holds nothing here, since no result is ever taken away; the oldest are forgotten."""
        if result is not None:
            self._last_handle = self._last_handle % 0xFFFF_FFFF + 1
            self._handles[self._last_handle] = None
            if len(self._handles) > MOST_HANDLES:
                del self._handles[next(iter(self._handles))]
        return [
            ua.Variant(self._last_handle if result is not None else 0, ua.VariantType.UInt32),
            ua.Variant(result, ua.VariantType.ExtensionObject),
            ua.Variant(0 if result is not None else UNKNOWN, ua.VariantType.Int32),
        ]


def result_id(published: ResultMessage) -> str:
    """Return the name of a result, another one for another file: MACHINE/SURVEY/ROUND/HASH."""
    return "/".join((published.machine, published.survey, published.round, published.sha256[:16]))


def _members(meta: Any) -> list[tuple[str, Any]]:
    """Return what the meta data say, by name."""
    return [(each.name, value) for each in META if (value := getattr(meta, each.name)) is not None]


def _typed(value: Any) -> tuple[Any, ua.VariantType]:
    kinds = {
        bool: ua.VariantType.Boolean,
        str: ua.VariantType.String,
        datetime: ua.VariantType.DateTime,
        ua.LocalizedText: ua.VariantType.LocalizedText,
    }
    if isinstance(value, int) and not isinstance(value, bool):
        return int(value), ua.VariantType.Int32
    return value, kinds.get(type(value), ua.VariantType.ExtensionObject)


def _moment(text: str) -> datetime | None:
    with suppress(ValueError):
        return datetime.strptime(text, _MINUTE).replace(tzinfo=UTC)
    return None
