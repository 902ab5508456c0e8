"""The part of OPC 40001-101 (OPC UA for Machinery, Result Transfer) that a result needs, as nodes of a server.

Names, node ids, data types and modelling rules are those of the nodeset of version 1.00.0 that the OPC Foundation publishes (UA-Nodeset,
Machinery/Result, 2023-01-01). Left out of it: the encodings in XML and JSON, the type dictionaries of old clients, and what is optional and
not offered here (GetResultIdListFiltered, file transfer). AcknowledgeResults, optional in 1.01, is not offered either.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

from asyncua import Server, ua
from asyncua.common.manage_nodes import create_data_type, create_encoding
from asyncua.common.structures104 import new_struct_field

NAMESPACE = "http://opcfoundation.org/UA/Machinery/Result/"
VERSION, PUBLISHED = "1.00.0", datetime(2023, 1, 1, tzinfo=UTC)
NAME_OF_INSTANCE = "ResultManagement"
EVENT_TYPE, MANAGEMENT_TYPE, RESULT_TYPE = 1002, 1004, 2001
_EVALUATION, _TIMES, _META, _RESULT, _RESULT_BINARY = 3002, 3006, 3007, 3008, 5008
BOOLEAN, INT32, INT64, STRING, LOCALIZED, STRUCTURE, ANYTHING = 1, 6, 8, 12, 21, 22, 24
DURATION, UTC_TIME, URI, HANDLE, TRIMMED = 290, 294, 23751, 31917, 31918
OWN = -1
"""Offset of data types of the model's own namespace: ``OWN - id``."""
MANDATORY, OPTIONAL = 78, 80
EVALUATIONS = ("Undefined", "OK", "NotOK", "NotDecidable")


class Member(NamedTuple):
    """One field of the meta data: its name and type, and the ids of its variable below the type of results and below that of events."""

    name: str
    type: int
    below_result: int
    below_event: int
    array: bool = False
    rule: int = OPTIONAL


META = (
    Member("ResultId", TRIMMED, 6012, 6034, rule=MANDATORY),
    Member("HasTransferableDataOnFile", BOOLEAN, 6013, 6060),
    Member("IsPartial", BOOLEAN, 6014, 6063),
    Member("IsSimulated", BOOLEAN, 6015, 6064),
    Member("ResultState", INT32, 6016, 6072),
    Member("StepId", TRIMMED, 6017, 6074),
    Member("PartId", TRIMMED, 6018, 6066),
    Member("ExternalRecipeId", TRIMMED, 6019, 6058),
    Member("InternalRecipeId", TRIMMED, 6020, 6062),
    Member("ProductId", TRIMMED, 6021, 6068),
    Member("ExternalConfigurationId", TRIMMED, 6022, 6057),
    Member("InternalConfigurationId", TRIMMED, 6023, 6061),
    Member("JobId", TRIMMED, 6024, 6065),
    Member("CreationTime", UTC_TIME, 6025, 6056),
    Member("ProcessingTimes", OWN - _TIMES, 6026, 6067),
    Member("ResultUri", URI, 6027, 6073, array=True),
    Member("ResultEvaluation", OWN - _EVALUATION, 6028, 6069),
    Member("ResultEvaluationCode", INT64, 6030, 6070),
    Member("ResultEvaluationDetails", LOCALIZED, 6029, 6071),
    Member("FileFormat", STRING, 6031, 6059, array=True),
)
_TIMES_FIELDS = (
    ("StartTime", UTC_TIME, False),
    ("EndTime", UTC_TIME, False),
    ("AcquisitionDuration", DURATION, True),
    ("ProcessingDuration", DURATION, True),
)
_CONTENT = new_struct_field("ResultContent", ua.NodeId(ANYTHING), array=True)
GET_LATEST, GET_BY_ID, RELEASE = "GetLatestResult", "GetResultById", "ReleaseResultHandle"
_GIVEN = (("ResultHandle", HANDLE), ("Result", OWN - _RESULT), ("Error", INT32))
METHODS = {
    GET_LATEST: (7008, 6054, (("Timeout", INT32),), 6055, _GIVEN),
    GET_BY_ID: (7005, 6048, (("ResultId", TRIMMED), ("Timeout", INT32)), 6049, _GIVEN),
    RELEASE: (7007, 6052, (("ResultHandle", HANDLE),), 6053, (("Error", INT32),)),
}
"""Id of the method, of its input arguments, these, id of its output arguments, these; names and types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """The model within a server: index of its namespace, and the classes of its structures."""

    index: int
    result: Any
    meta: Any
    times: Any
    evaluation: Any

    def id(self, number: int) -> ua.NodeId:
        """Return a node of the model."""
        return ua.NodeId(number, self.index)

    def name(self, text: str) -> ua.QualifiedName:
        """Return a name of the model."""
        return ua.QualifiedName(text, self.index)

    def type(self, number: int) -> ua.NodeId:
        """Return a data type as the tables above write it."""
        return _type(number, self.index)


def _type(number: int, index: int) -> ua.NodeId:
    return ua.NodeId(number, 0) if number >= 0 else ua.NodeId(OWN - number, index)


async def add_model(server: Server) -> Model:
    """Put the model's types into a server."""
    index = await server.register_namespace(NAMESPACE)
    await _data_types(server, index)
    known = await server.load_data_type_definitions()
    await _let_subtypes_in(server, index)
    model = Model(
        index=index, result=known["ResultDataType"], meta=known["ResultMetaDataType"], times=known["ProcessingTimesDataType"],
        evaluation=known["ResultEvaluationEnum"],
    )  # fmt: skip
    nodes = Nodes(server, model)
    await nodes.add(ua.NodeClass.VariableType, RESULT_TYPE, "ResultType", 63, 45, model.type(OWN - _RESULT))
    await nodes.result_parts(RESULT_TYPE, meta=6009, members="below_result", content=6010)
    await nodes.add(ua.NodeClass.ObjectType, EVENT_TYPE, "ResultReadyEventType", 2041, 45, abstract=True)
    await nodes.add(
        ua.NodeClass.Variable, 6032, "Result", EVENT_TYPE, 47, model.type(OWN - _RESULT), kind=model.id(RESULT_TYPE), rule=MANDATORY
    )
    await nodes.result_parts(6032, meta=6033, members="below_event")
    await nodes.add(ua.NodeClass.ObjectType, MANAGEMENT_TYPE, "ResultManagementType", 58, 45)
    await nodes.add(ua.NodeClass.Object, 5011, "Results", MANAGEMENT_TYPE, 47, kind=ua.NodeId(61), rule=OPTIONAL)
    management = server.get_node(model.id(MANAGEMENT_TYPE))
    await management.add_reference(model.id(EVENT_TYPE), ua.ObjectIds.GeneratesEvent, bidirectional=False)
    named = ua.QualifiedName("DefaultInstanceBrowseName", 0)
    await management.add_property(model.id(6037), named, model.name(NAME_OF_INSTANCE))
    for name in METHODS:
        await nodes.method(name, management.nodeid, rule=OPTIONAL)
    await _about_namespace(server, model)
    return model


class Nodes:
    """Adds nodes to a server with their own ids and kinds of reference."""

    def __init__(self, server: Server, model: Model) -> None:
        self._server, self._model = server, model

    async def add(  # noqa: PLR0913  # one argument an attribute
        self, what: ua.NodeClass, number: int | ua.NodeId, name: str | ua.QualifiedName, parent: int | ua.NodeId, reference: int,
        data_type: ua.NodeId | None = None, *, kind: ua.NodeId | None = None, rule: int = 0, array: bool = False, abstract: bool = False,
    ) -> Any:  # fmt: skip
        """Add one node below another; numbers below 1000 are of OPC UA itself, as is 2041, the others of the model. Return the node."""
        item = ua.AddNodesItem()
        item.RequestedNewNodeId, item.ParentNodeId = self._id(number), self._id(parent)
        named = self._model.name(name) if isinstance(name, str) else name
        item.BrowseName, item.NodeClass, item.ReferenceTypeId = named, what, ua.NodeId(reference)
        item.NodeAttributes = _attributes(what, named.Name, data_type, array=array, abstract=abstract)
        if kind is not None:
            item.TypeDefinition = kind
        (added,) = await self._server.iserver.isession.add_nodes([item])
        added.StatusCode.check()
        node = self._server.get_node(added.AddedNodeId)
        if rule:
            await node.add_reference(ua.NodeId(rule), ua.ObjectIds.HasModellingRule, bidirectional=False)
        return node

    async def result_parts(self, parent: int, *, meta: int, members: str, content: int = 0) -> None:
        """Add the meta data with its members, and the content, below the type of results or a variable of it (OPC 40001-101, 9.1)."""
        model, structured, variable = self._model, ua.ObjectIds.HasStructuredComponent, ua.NodeId(63)
        await self.add(
            ua.NodeClass.Variable, meta, "ResultMetaData", parent, structured, model.type(OWN - _META), kind=variable, rule=MANDATORY
        )
        if content:
            await self.add(
                ua.NodeClass.Variable,
                content,
                "ResultContent",
                parent,
                structured,
                ua.NodeId(ANYTHING),
                kind=variable,
                rule=OPTIONAL,
                array=True,
            )
        for each in META:
            await self.add(
                ua.NodeClass.Variable, getattr(each, members), each.name, meta, structured, model.type(each.type), kind=variable,
                rule=each.rule, array=each.array,
            )  # fmt: skip

    async def method(self, name: str, parent: ua.NodeId, *, rule: int = 0, own: int = 0) -> Any:
        """Add a method with its arguments; of an instance, ``own`` is the namespace that gives it an id. Return the node."""
        number, number_in, given, number_out, returned = METHODS[name]
        node = await self.add(ua.NodeClass.Method, ua.NodeId(0, own) if own else number, name, parent, 47, rule=rule)
        for at, what, arguments in ((number_in, "InputArguments", given), (number_out, "OutputArguments", returned)):
            place, named = ua.NodeId(0, own) if own else self._model.id(at), ua.QualifiedName(what, 0)
            of_type = MANDATORY if rule else 0
            method = await self.add(
                ua.NodeClass.Variable, place, named, node.nodeid, 46, ua.NodeId(296), kind=ua.NodeId(68), rule=of_type, array=True
            )  # fmt: skip
            await method.write_value([self._argument(*each) for each in arguments])
        return node

    def _argument(self, name: str, kind: int) -> ua.Argument:
        argument = ua.Argument()
        argument.Name, argument.DataType, argument.ValueRank = name, self._model.type(kind), ua.ValueRank.Scalar
        return argument

    def _id(self, number: int | ua.NodeId) -> ua.NodeId:
        if isinstance(number, ua.NodeId):
            return number
        return ua.NodeId(number) if number < 1000 or number == 2041 else self._model.id(number)


def _attributes(what: ua.NodeClass, name: str, data_type: ua.NodeId | None, *, array: bool, abstract: bool) -> Any:
    made = getattr(ua, f"{what.name}Attributes")()
    made.DisplayName = made.Description = ua.LocalizedText(name)
    if what in (ua.NodeClass.Variable, ua.NodeClass.VariableType):
        made.DataType, made.ValueRank = data_type, ua.ValueRank.OneDimension if array else ua.ValueRank.Scalar
        made.Value = ua.Variant(None)
    if what is ua.NodeClass.Variable:
        made.AccessLevel = made.UserAccessLevel = ua.AccessLevel.CurrentRead.mask
    if what in (ua.NodeClass.ObjectType, ua.NodeClass.VariableType):
        made.IsAbstract = abstract
    if what is ua.NodeClass.Method:
        made.Executable = made.UserExecutable = True
    return made


async def _data_types(server: Server, index: int) -> None:
    evaluation = await create_data_type(
        server.nodes.enum_data_type, ua.NodeId(_EVALUATION, index), ua.QualifiedName("ResultEvaluationEnum", index)
    )
    defined = ua.EnumDefinition()
    defined.Fields = [ua.EnumField(Value=at, DisplayName=ua.LocalizedText(name), Name=name) for at, name in enumerate(EVALUATIONS)]
    await evaluation.write_data_type_definition(defined)
    await _structure(
        server,
        index,
        (_TIMES, 5003, "ProcessingTimesDataType"),
        [new_struct_field(n, _type(t, index), optional=o) for n, t, o in _TIMES_FIELDS],
    )
    members = [new_struct_field(each.name, _type(each.type, index), array=each.array, optional=each.rule == OPTIONAL) for each in META]
    await _structure(server, index, (_META, 5005, "ResultMetaDataType"), members)
    # asyncua makes its class of this definition: a field of the abstract structure is an extension object to it
    meta = new_struct_field("ResultMetaData", ua.NodeId(STRUCTURE))
    await _structure(server, index, (_RESULT, _RESULT_BINARY, "ResultDataType"), [meta, _CONTENT])


async def _let_subtypes_in(server: Server, index: int) -> None:
    """Define the result for clients as the model does: its meta data may be of a subtype of their type.

    A subtyped value is an extension object on the wire (OPC 10000-6, 5.2.7), as a field of the abstract structure is; but a client that
    builds its decoders from definitions has none for the abstract structure. "IsOptional" of such a field lets subtypes in.
    """
    meta = new_struct_field("ResultMetaData", _type(OWN - _META, index), optional=True)
    defined = ua.StructureDefinition()
    defined.StructureType = ua.StructureType.StructureWithSubtypedValues
    defined.BaseDataType, defined.Fields = ua.NodeId(STRUCTURE), [meta, _CONTENT]
    defined.DefaultEncodingId = ua.NodeId(_RESULT_BINARY, index)
    await server.get_node(ua.NodeId(_RESULT, index)).write_data_type_definition(defined)


async def _structure(server: Server, index: int, identity: tuple[int, int, str], fields: list[ua.StructureField]) -> None:
    number, encoding, name = identity
    node = await create_data_type(server.nodes.base_structure_type, ua.NodeId(number, index), ua.QualifiedName(name, index))
    binary = await create_encoding(node, ua.NodeId(encoding, index), ua.QualifiedName("Default Binary", 0))
    defined = ua.StructureDefinition()
    optional = any(each.IsOptional for each in fields)
    defined.StructureType = ua.StructureType.StructureWithOptionalFields if optional else ua.StructureType.Structure
    defined.BaseDataType, defined.DefaultEncodingId, defined.Fields = server.nodes.base_structure_type.nodeid, binary.nodeid, fields
    await node.write_data_type_definition(defined)


async def _about_namespace(server: Server, model: Model) -> None:
    """Say which version of the model stands here, and that it is a part (OPC 10000-5, 6.3.14)."""
    about = await server.get_node(ua.NodeId(11715)).add_object(
        model.id(5007), model.name(NAMESPACE), ua.NodeId(11616), instantiate_optional=False
    )
    values = {"IsNamespaceSubset": True, "NamespacePublicationDate": PUBLISHED, "NamespaceUri": NAMESPACE, "NamespaceVersion": VERSION}
    for name, value in values.items():
        await (await about.get_child(ua.QualifiedName(name, 0))).write_value(value)
