"""The [plc] sections that are shipped, and what a survey file may ask of each protocol."""

import tomllib
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.signals import plan_reads
from stepdiag.daq.survey.controls import CONTROLS, control_section
from stepdiag.daq.survey.file import parse_survey
from testkit.running.survey_files import SMALLEST

GUIDE = Path(__file__).parents[3] / "docs" / "controls.md"
S7 = '[plc]\ntransport = "s7"\n'
OVERLAPPING = "[plc]\n" + control_section("siemens-828d", "h").replace(
    "enabled = false", "enabled = true"
).replace("address = 6", "address = 3")
TNC = '[plc]\ntransport = "lsv2"\n'


@pytest.mark.parametrize("name", CONTROLS)
def test_a_shipped_section_is_accepted_and_tells_where_the_machine_stands(name):
    plc = parse_survey(
        f"{SMALLEST}\n[plc]\n{control_section(name, 'mill.example.org')}", "s"
    ).plc
    assert plc.host == "mill.example.org"
    assert {"stopped", "stop_count", "setup"} <= set(plc.signal_names)
    assert plc.tcp_port == {"tcp": 502, "s7": 102, "lsv2": 19000}[plc.transport]
    assert not plc.handshake.enabled


@pytest.mark.parametrize(("name", "reads"), [("siemens-828d", 4), ("heidenhain", 4)])
def test_a_poll_asks_for_few_ranges(name, reads):
    """An S7 answers all in one telegram; a TNC is asked for what tells of standing first, and again
    at the end."""
    plc = parse_survey(f"{SMALLEST}\n[plc]\n{control_section(name, 'h')}", "s").plc
    assert (
        len(plan_reads(plc.signals, () if plc.transport == "s7" else plc.standing)) == reads
    )


@pytest.mark.parametrize("name", ["siemens-828d", "heidenhain"])
def test_the_guide_shows_what_is_shipped(name):
    shown = [
        tomllib.loads(part.split("```")[0])["plc"]
        for part in GUIDE.read_text(encoding="utf-8").split("```toml\n")[1:]
    ]
    shipped = tomllib.loads("[plc]\n" + control_section(name, "h"))["plc"]
    assert [
        each | {"host": "h"} for each in shown if each["transport"] == shipped["transport"]
    ] == [shipped]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            S7,
            "plc.signals: expected the words that the NC program writes, and the exact-stop bits",
        ),
        (
            S7 + "[plc.signals.stopped]\naddress = 1",
            'expected a data block, such as "db4900", over S7, found "holding"',
        ),
        (
            S7 + '[plc.signals.stopped]\naddress = 1\ntable = "db0"',
            'plc.signals.stopped.table: expected "coil", "discrete"',
        ),
        (
            S7 + '[plc.signals.stopped]\naddress = 1\ntable = "db1"\ntype = "bit"\nbit = 8',
            "plc.signals.stopped.bit: expected 0 to 7, because an address in db1",
        ),
        (
            TNC + '[plc.signals.stopped]\naddress = 1\ntable = "B"\ntype = "int32"',
            (
                'plc.signals.stopped.order: expected "DCBA", the byte order of this control, '
                'found "ABCD"'
            ),
        ),
        (
            TNC + '[plc.signals.stopped]\naddress = 1\ntable = "M"\ntype = '
            '"bit"\n[plc.handshake]\nenabled = true',
            "plc.handshake.enabled: expected false, because stepdiag writes nothing over LSV2",
        ),
        ('[plc.signals.stopped]\naddress = 1\ntable = "db1"', "over Modbus"),
        (
            '[plc.handshake]\nenabled = true\ntable = "db4900"',
            'plc.handshake.table: expected "holding"',
        ),
        (
            OVERLAPPING,
            "plc.handshake.address: expected a free register",
        ),
    ],
)
def test_what_a_protocol_cannot_do_is_refused_by_field(text, message):
    with pytest.raises(UsageError) as refusal:
        parse_survey(f"{SMALLEST}\n{text}", "survey.toml")
    assert message in str(refusal.value)


def test_what_does_not_fit_into_one_telegram_is_refused():
    """Two polls of one machine are two moments."""
    scattered = "".join(
        f'[plc.inputs.i{n}]\ntable = "db{n}"\naddress = 0\n' for n in range(1, 25)
    )
    with pytest.raises(UsageError, match="one telegram of 240 bytes can request and return"):
        parse_survey(
            f'{SMALLEST}\n{S7}[plc.signals.stopped]\ntable = "db99"\naddress = 0\n{scattered}',
            "s",
        )
