"""The nodesets are those that the OPC Foundation publishes, and the server's definitions are
theirs."""

import asyncio
import hashlib
import xml.etree.ElementTree as ET

import pytest

pytest.importorskip("asyncua")

from asyncua import Server, ua

from stepdiag.publish.models import FOLDER, ORDER, RESULTS, add_models

HASHES = {
    "Opc.Ua.Di": "ec376a3992f38740fd9263ec06e7560a",
    "Opc.Ua.IA": "ac91d6691debd496a73753b22a3a729f",
    "Opc.Ua.MachineTool": "849b29895d096867856642c777b1f6b1",
    "Opc.Ua.Machinery": "054a08bb39a8cd25e93cbbfe13eaca1e",
    "Opc.Ua.Machinery.Result": "bcbfc0a1070eda07b4af6b2fa656beb6",
}


def test_the_nodesets_are_unchanged() -> None:
    found = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()[:32]
        for path in FOLDER.iterdir()
    }
    assert found == {f"{name}.NodeSet2.xml": HASHES[name] for name in ORDER}


def test_every_node_of_the_results_is_there_as_published() -> None:
    """By id: its name and class, and of a variable its data type and rank."""

    async def run() -> int:
        server = Server()
        await server.init()
        index = (await add_models(server)).results
        root = ET.parse(FOLDER / f"{RESULTS}.NodeSet2.xml").getroot()
        space = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
        aliases = {each.get("Alias"): each.text for each in root.iter(f"{space}Alias")}
        count = 0
        for each in root:
            kind = each.tag.removeprefix(f"{space}UA")
            if "NodeId" not in each.attrib or kind == each.tag:
                continue
            node = server.get_node(_id(each.attrib["NodeId"], index))
            assert (await node.read_browse_name()).Name == each.attrib[
                "BrowseName"
            ].removeprefix("1:")
            assert (await node.read_node_class()).name == kind
            if kind in ("Variable", "VariableType"):
                named = each.get("DataType", "i=24")
                assert await node.read_data_type() == _id(aliases.get(named) or named, index)
                assert await node.read_value_rank() == int(each.get("ValueRank", "-1"))
            count += 1
        return count

    assert asyncio.run(run()) == 119


def _id(text: str, index: int) -> ua.NodeId:
    number = int(text.rpartition("=")[2])
    return ua.NodeId(number, index if text.startswith("ns=1") else 0)
