"""The machine's object in the address space of an OPC UA server: state, findings, results (OPC
40001-101), prognoses (OPC 40501-1)."""

from contextlib import suppress
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any

import msgspec
import structlog
from asyncua import Server, ua
from asyncua.common.instantiate_util import instantiate

from stepdiag.base.conformity import together
from stepdiag.base.messages import message
from stepdiag.daq.survey.models import Survey
from stepdiag.fleet.trend import Trend, day
from stepdiag.publish.messages import Findings, ResultMessage, State, Watched
from stepdiag.publish.models import Models, add_models
from stepdiag.publish.prognosis import leavings
from stepdiag.texts.texts import UNITS

OWN_NAMESPACE = "urn:stepdiag:publish"
UNKNOWN = -1
"""Error code of a method for a result or a handle that does not exist; the model reserves codes
below 0 for the application."""
MOST_HANDLES = 1000
EVALUATED = {
    "": "Undefined",
    "conform": "OK",
    "not_conform": "NotOK",
    "not_decidable": "NotDecidable",
}
"""The verdicts about a machine, each with its term in OPC 40001-101."""
_MINUTE = "%Y-%m-%d %H:%M UTC"
_RESULT, _RESULT_TYPE, _EVENT_TYPE, _MANAGEMENT_TYPE = 3008, 2001, 1002, 1004
_NOTIFICATION_TYPE, _MAINTENANCE_TYPE = 7, 9

_log = structlog.get_logger("publish")


class Station:
    """The machine's object in the address space: created once, then updated."""

    def __init__(self, server: Server, models: Models, own: int) -> None:
        self._server, self._models, self._own = server, models, own
        self._values: dict[str, Any] = {}
        self._results: dict[str, Any] = {}
        self._handles: dict[int, None] = {}
        self._last_handle = 0
        self._round = ""
        self._folder: Any = None
        self._prognoses: Any = None
        self._event: Any = None

    @classmethod
    async def made(cls, server: Server, survey: Survey, watched: Watched) -> "Station":
        """Add the models and the machine's object to a server, with every existing result."""
        station = cls(
            server, await add_models(server), await server.register_namespace(OWN_NAMESPACE)
        )
        await station._build(survey)
        for each in watched.history():
            await station._offer(*each, new=False)
        await station.write(watched)
        await station._predict(leavings(watched.folder, datetime.now(UTC)))
        return station

    async def _build(self, survey: Survey) -> None:
        own, server = self._own, self._server
        machine = await server.nodes.objects.add_object(own, survey.identity.machine)
        await machine.add_property(own, "Survey", survey.identity.name)
        state = await machine.add_object(own, "State")
        for field in msgspec.structs.fields(State):
            kind = ua.VariantType.Boolean if field.type is bool else ua.VariantType.String
            if field.type in (bool, str) and field.name not in ("machine", "survey"):
                name = field.name.title().replace("_", "")
                self._values[field.name] = await state.add_variable(
                    own, name, False if field.type is bool else "", kind
                )
        self._values["findings"] = await machine.add_variable(
            own, "Findings", ua.Variant([], ua.VariantType.String, is_array=True)
        )
        methods = {
            "GetLatestResult": self._latest,
            "GetResultById": self._by_id,
            "ReleaseResultHandle": self._release,
        }
        offered = {"Results", "DefaultInstanceBrowseName", *methods}
        management, parts = await self._instance(
            machine, "ResultManagement", self._models.results, _MANAGEMENT_TYPE, offered
        )
        self._folder = parts["Results"]
        for name, answer in methods.items():
            server.link_method(parts[name], answer)
        _, parts = await self._instance(
            machine,
            "Notification",
            self._models.machine_tool,
            _NOTIFICATION_TYPE,
            {"Prognoses"},
        )
        self._prognoses = parts["Prognoses"]
        # the event type of the model is abstract: the events that are sent have a subtype
        event = await server.get_node(
            ua.NodeId(_EVENT_TYPE, self._models.results)
        ).add_object_type(own, "StepdiagResultReadyEventType")
        self._event = await server.get_event_generator(event, management)

    async def _instance(
        self, parent: Any, name: str, index: int, kind: int, offered: set[str]
    ) -> tuple[Any, dict[str, Any]]:
        named = ua.QualifiedName(name, index)
        node = await parent.add_object(
            ua.NodeId(0, self._own), named, ua.NodeId(kind, index), instantiate_optional=True
        )
        parts = {
            (await each.read_browse_name()).Name: each for each in await node.get_children()
        }
        await self._server.delete_nodes(
            [each for part, each in parts.items() if part not in offered], recursive=True
        )
        return node, parts

    async def write(self, watched: Watched) -> None:
        """Write the present state and findings of one round, and add a new result."""
        state, *result = watched.now()
        values = {name: getattr(state, name) for name in self._values if name != "findings"}
        published: list[tuple[Findings, ResultMessage]] = []
        if result:
            findings, figures = result
            assert isinstance(findings, Findings)
            assert isinstance(figures, ResultMessage)
            published = [(findings, figures)]
            values["findings"] = [
                msgspec.json.encode(each).decode() for each in findings.findings
            ]
        elif not values["complete"] or values["round"] != self._round:
            values[
                "findings"
                # findings of another round, or of a removed result, do not belong to this round
            ] = []
        self._round, now = values["round"], datetime.now(UTC)
        for name, value in values.items():
            kind = (
                ua.VariantType.Boolean if isinstance(value, bool) else ua.VariantType.String
            )
            variant = ua.Variant(value, kind, is_array=isinstance(value, list))
            await self._values[name].write_value(
                ua.DataValue(variant, SourceTimestamp=now, ServerTimestamp=now)
            )
        for each in published:
            if await self._offer(*each, new=True):
                await self._predict(leavings(watched.folder, now))

    async def _offer(
        self, findings: Findings, published: ResultMessage, *, new: bool
    ) -> bool:
        name = result_id(published)
        if name in self._results:
            self._results[name] = (
                self._results.pop(name) if new else self._results[name]
            )  # put back unchanged: the latest value is sent once more
            return False
        meta = self._meta(name, findings, published)
        content = [
            ua.Variant(msgspec.json.encode(each).decode(), ua.VariantType.String)
            for each in (published, findings)
        ]
        result = ua.ResultDataType(ResultMetaData=meta, ResultContent=content)
        self._results[name] = result
        await self._variable(name, result)
        if new:
            event = self._event.event
            parts = {
                f"Result/ResultMetaData/{member}": value
                for member, value in _members(meta).items()
            }
            for path, value in {
                "Result": result,
                "Result/ResultMetaData": meta,
                **parts,
            }.items():
                event.add_variable(path, *_typed(value))
            await self._event.trigger(message=f"result {name}")
            _log.info("opcua-result", result=name)
        return True

    def _meta(self, name: str, findings: Findings, published: ResultMessage) -> Any:
        """Return the meta data of a result: the part is the machine, the job is the survey. A
        calibration without a tolerance has no verdict."""
        wrong = sorted({each.code for each in findings.findings if each.severity == "error"})
        judged = [one.verdict for one in published.conformity or ()]
        verdict = together(judged) if judged else ""
        if wrong:
            verdict = "not_decidable"
        begun, ended = _moment(published.begun), _moment(published.ended)
        return ua.ResultMetaDataType(
            ResultId=name,
            HasTransferableDataOnFile=False,
            IsPartial=False,
            PartId=published.machine,
            JobId=published.survey,
            CreationTime=ended,
            ProcessingTimes=ua.ProcessingTimesDataType(StartTime=begun, EndTime=ended)
            if begun and ended
            else None,
            ResultEvaluation=getattr(ua.ResultEvaluationEnum, EVALUATED[verdict]),
            ResultEvaluationDetails=ua.LocalizedText(", ".join(wrong)) if wrong else None,
        )

    async def _variable(self, name: str, result: Any) -> None:
        index, own = self._models.results, self._own
        kind, named = (
            self._server.get_node(ua.NodeId(_RESULT_TYPE, index)),
            ua.QualifiedName(name, own),
        )
        node, *_ = await instantiate(
            self._folder, kind, ua.NodeId(0, own), named, ua.LocalizedText(name)
        )
        meta, content, reduced = [
            await node.get_child(f"{index}:{part}")
            for part in ("ResultMetaData", "ResultContent", "ReducedResultContent")
        ]
        await reduced.delete(recursive=True)
        values = _members(result.ResultMetaData)
        for part in await meta.get_children():
            member = (await part.read_browse_name()).Name
            if member in values:
                await part.write_value(ua.Variant(*_typed(values[member])))
            else:
                await part.delete(recursive=True)
        await meta.write_value(
            ua.Variant(result.ResultMetaData, ua.VariantType.ExtensionObject)
        )
        await content.write_value(
            ua.Variant(result.ResultContent, ua.VariantType.Variant, is_array=True)
        )
        await node.write_value(ua.Variant(result, ua.VariantType.ExtensionObject))

    async def _predict(self, trends: list[Trend]) -> None:
        await self._server.delete_nodes(await self._prognoses.get_children(), recursive=True)
        index = self._models.machine_tool
        for each in trends:
            assert each.leaving is not None
            assert each.leaving.likely is not None
            name, unit = each.series.quantity, UNITS[each.series.unit]
            earliest = day(each.leaving.earliest or each.leaving.likely)
            words = message(
                "leaves-tolerance",
                quantity=name,
                limit=each.leaving.tolerance,
                unit=unit,
                earliest=earliest,
            )
            node = await self._prognoses.add_object(
                ua.NodeId(0, self._own),
                ua.QualifiedName(name, self._own),
                ua.NodeId(_MAINTENANCE_TYPE, index),
            )
            await (await node.get_child(f"{index}:PredictedTime")).write_value(
                each.leaving.likely, ua.VariantType.DateTime
            )
            await (await node.get_child(f"{index}:Activity")).write_value(
                ua.LocalizedText(str(words), "en")
            )

    async def _latest(self, _parent: ua.NodeId, _timeout: ua.Variant) -> list[ua.Variant]:
        return self._given(next(reversed(self._results.values()), None))

    async def _by_id(
        self, _parent: ua.NodeId, name: ua.Variant, _timeout: ua.Variant
    ) -> list[ua.Variant]:
        return self._given(self._results.get(str(name.Value or "").strip()))

    async def _release(self, _parent: ua.NodeId, handle: ua.Variant) -> list[ua.Variant]:
        known = handle.Value in self._handles
        self._handles.pop(handle.Value, None)
        return [ua.Variant(0 if known else UNKNOWN, ua.VariantType.Int32)]

    def _given(self, result: Any) -> list[ua.Variant]:
        """Return a handle, the result and an error code. A handle reserves no result, because no
        result is ever removed; the oldest handles are discarded."""
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
    """Return the name of a result, different for different files: MACHINE/SURVEY/ROUND/HASH."""
    return "/".join(
        (published.machine, published.survey, published.round, published.sha256[:16])
    )


def _members(meta: Any) -> dict[str, Any]:
    return {
        field.name: value
        for field in fields(meta)
        if field.init and (value := getattr(meta, field.name)) not in (None, [])
    }


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
