"""The PLC examples of the documentation, read and run: what they write is what the recording
decodes."""

import json
import re
import struct
import subprocess
from pathlib import Path

import pytest

from stepdiag.daq.formats.signals import CONTRACT_SIGNALS, SignalDecoder, plan_reads
from stepdiag.daq.records.events import ModbusBlock

PLC = Path(__file__).parents[2] / "docs" / "plc"
NOW = {
    "programStands": True,
    "inPosition": True,
    "programRuns": True,
    "alarm": False,
    "setup": 2,
    "stopCount": 5,
    "beat": True,
    "xMm": 437.5,
    "yMm": -50.0001,
    "zMm": 37.5,
    "materialC": 21.34,
    "airC": -0.5,
    "pressureHpa": 1002.3,
    "humidityPercent": 44.1,
}


def _signed(bits):
    return lambda value: (int(value) + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)


CALLS = {
    **{
        f"{real}_TO_{whole}": round
        for real in ("REAL", "LREAL")
        for whole in ("INT", "UINT", "DINT")
    },
    **{f"{whole}_TO_WORD": lambda value: value % 2**16 for whole in ("INT", "UINT", "DWORD")},
    "DINT_TO_DWORD": lambda value: value % 2**32,
    "WORD_TO_INT": _signed(16),
    "WORD_TO_UINT": int,
    "SHR": lambda value, by: value >> by,
}


def statements(text):
    """Return a structured text as Python: assignments, IF and the operators that the examples
    use."""
    body = re.sub(r"//[^\n]*|\(\*.*?\*\)", "", text, flags=re.DOTALL).rsplit("END_VAR", 1)[-1]
    body = re.sub(r"\bBEGIN\b|\bEND_FUNCTION_BLOCK\b|(?<!16)#", "", body)
    lines, depth = [], 0
    for part in re.split(r";|\bTHEN\b", body):
        line = " ".join(part.split())
        if line == "END_IF":
            depth -= 1
        elif line.startswith("IF "):
            lines.append("    " * depth + f"if {_expression(line[3:])}:")
            depth += 1
        elif line:
            target, _, value = line.partition(":=")
            lines.append("    " * depth + f"{target.strip()} = {_expression(value)}")
    return "\n".join(lines)


def _expression(text):
    text = re.sub(r"\b(IN|N) :=", "", text).replace("<>", "!=").replace(" MOD ", " % ")
    bits = "16#" in text
    text = (
        text.replace("16#", "0x")
        .replace(" AND ", " & " if bits else " and ")
        .replace(" OR ", " | " if bits else " or ")
    )
    return text.strip()


def cycled(file, **changed):
    """Return the registers after one cycle of a block, and what it gives back to the program."""
    names = (
        NOW
        | {"holding": [0] * 100 + [7], "lastBeat": False, "beats": 11, "cycles": 11}
        | changed
    )
    exec(statements((PLC / file).read_text(encoding="utf-8")), CALLS, names)
    return names["holding"], names["captured"]


def decoded(words):
    """Return the signals in registers 0 to 13, by the recording's own decoder."""
    (read,) = plan_reads(CONTRACT_SIGNALS)
    answer = struct.pack(f">{read.count}H", *words[read.address : read.address + read.count])
    return SignalDecoder(CONTRACT_SIGNALS).decode(ModbusBlock(0, 0, (read,), (answer,)))


def assert_says(words, now):
    """Every signal of the block is what the machine is."""
    said = decoded(words)
    assert (said.stopped, said.running, said.alarm) == (
        now["programStands"] and now["inPosition"],
        now["programRuns"],
        now["alarm"],
    )
    assert (said.stop_count, said.setup) == (now["stopCount"], now["setup"])
    assert said.commanded_mm == pytest.approx((now["xMm"], now["yMm"], now["zMm"]), abs=1e-9)
    air = (
        said.material_temperature_c,
        said.air_temperature_c,
        said.air_pressure_hpa,
        said.relative_humidity_percent,
    )
    assert air == pytest.approx(
        (now["materialC"], now["airC"], now["pressureHpa"], now["humidityPercent"])
    )


BLOCKS = ("tia_stepdiag_block.scl", "codesys_stepdiag_block.st")
CASES = [
    {},
    {"inPosition": False},
    {"programStands": False, "alarm": True},
    {"programRuns": False, "stopCount": 32000, "xMm": -1234.5678},
]


@pytest.mark.parametrize("file", BLOCKS)
@pytest.mark.parametrize("changed", CASES)
def test_a_block_says_what_the_machine_is(file, changed):
    words, captured = cycled(file, **changed)
    assert_says(words, NOW | changed)
    assert captured == 7
    assert decoded(words).heartbeat == 12


@pytest.mark.parametrize("file", BLOCKS)
def test_stopped_is_written_after_what_belongs_to_it(file):
    """Counter, setup and position first: a server that answers in between must not show an old one
    beside a new stop."""
    written = [
        int(number)
        for number in re.findall(
            r"holding\[(\d+)\] :=", (PLC / file).read_text(encoding="utf-8")
        )
    ]
    assert sorted(written) == list(range(14))
    assert written[-1] == 2


@pytest.mark.usefixtures("debian")
@pytest.mark.parametrize("changed", CASES)
def test_the_flow_says_what_the_machine_is(changed):
    """The function node as Node-RED runs it, with the message of the node before it; what it sends
    is a message of the server node."""
    now = NOW | changed
    flow = {
        node["type"]: node
        for node in json.loads((PLC / "node_red_flow.json").read_text(encoding="utf-8"))
    }
    assert flow["inject"]["wires"] == [[flow["function"]["id"]]]
    assert flow["function"]["wires"] == [[flow["modbus-server"]["id"]]]
    names = dict.fromkeys(json.loads(flow["inject"]["payload"]))
    given = dict(
        zip(names, (value for name, value in now.items() if name != "beat"), strict=True)
    )
    code = (
        "const held = {}; const context = { get: (k) => held[k], set: (k, v) => { held[k] = v; } "
        "};\n"
    )
    code += f"const run = (msg) => {{ {flow['function']['func']} }};\n"
    code += (
        f"run({{payload: {json.dumps(given)}}}); console.log(JSON.stringify(run({{payload: "
        f"{json.dumps(given)}}})));"
    )
    done = subprocess.run(
        ["node", "-e", code], capture_output=True, text=True, timeout=60, check=True
    )
    sent = json.loads(done.stdout)["payload"]
    assert (sent["register"], sent["address"]) == ("holding", 0)
    words = list(struct.unpack(">14H", bytes(sent["value"])))
    assert_says(words, now)
    assert decoded(words).heartbeat == 2
