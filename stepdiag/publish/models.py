"""The information models of the OPC Foundation in a server, imported from their published nodesets
(folder ``nodesets``).

OPC 40001-101 (Result Transfer) 1.00.0, and OPC 40501-1 (Machine Tools) 1.01.1 with its bases: DI
1.04.0, IA 1.01.2, OPC 40001-1 (Machinery) 1.02.0.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from asyncua import Server, ua

FOLDER = Path(__file__).parent / "nodesets"
RESULTS, MACHINE_TOOL = "Opc.Ua.Machinery.Result", "Opc.Ua.MachineTool"
ORDER = (RESULTS, "Opc.Ua.Di", "Opc.Ua.IA", "Opc.Ua.Machinery", MACHINE_TOOL)
_URI = "http://opcfoundation.org/UA/{}/"
_XML = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
_RESULT, _META = 3008, 3007


@dataclass(frozen=True, slots=True, kw_only=True)
class Models:
    """Indices of two namespaces in the server: results and machine tools."""

    results: int
    machine_tool: int


async def add_models(server: Server) -> Models:
    """Import the nodesets into a server that is initialised but not started; asyncua puts the
    classes of the nodesets' structures into ``ua``."""
    for name in ORDER:
        await server.import_xml(xmlstring=importable(name))
    index = await server.get_namespace_index(_URI.format("Machinery/Result"))
    # Clients read the definition as an extension object of this type (OPC 10000-6, 5.2.7).
    node = server.get_node(ua.NodeId(_RESULT, index))
    defined = await node.read_data_type_definition()
    defined.StructureType = ua.StructureType.StructureWithSubtypedValues
    defined.Fields[0].DataType, defined.Fields[0].IsOptional = ua.NodeId(_META, index), True
    await node.write_data_type_definition(defined)
    return Models(
        results=index,
        machine_tool=await server.get_namespace_index(_URI.format("MachineTool")),
    )


def importable(name: str) -> str:
    """Return a nodeset in the form that asyncua 2.1 can import.

    A variable without a data type gets BaseDataType, the default of the schema (OPC 10000-6, F.6).
    Default values of structures that the nodeset itself defines are left out, because their classes
    do not exist yet (KeyError). The meta data of a result become an abstract structure, because
    asyncua writes a field that permits subtypes without the header of an extension object.
    """
    root = ET.parse(FOLDER / f"{name}.NodeSet2.xml").getroot()  # noqa: S314  # a file of this package
    for kind in ("UAVariable", "UAVariableType"):
        for node in root.iter(f"{_XML}{kind}"):
            node.attrib.setdefault("DataType", "i=24")
    if name == RESULTS:
        for node in root:
            for value in node.findall(f"{_XML}Value"):
                if any("DataType" in each.tag for each in value.iter()):
                    node.remove(value)
        for field in root.iter(f"{_XML}Field"):
            if field.attrib.pop("AllowSubTypes", ""):
                field.set("DataType", "i=22")
    return ET.tostring(root, encoding="unicode")
