"""RFC 2217 without a socket: what is said, what is heard, in any pieces."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.links.ports.address import NetworkLine, network_line
from stepdiag.daq.links.ports.device import SerialSettings
from stepdiag.daq.links.ports.rfc2217 import ComPort
from testkit.streams import pieces

IAC, DONT, DO, WONT, WILL, SB, SE = 255, 254, 253, 252, 251, 250, 240
SETTINGS = SerialSettings(port="rfc2217://moxa:4001", baud=9600, parity="E", bytesize=7)


def answer(command, *value):
    return bytes((IAC, SB, 44, command + 100, *value, IAC, SE))


AGREED = answer(1, 0, 0, 0x25, 0x80) + answer(2, 7) + answer(3, 3) + answer(4, 1)


def test_the_settings_are_asked_for_once_the_other_side_takes_the_option():
    port = ComPort(SETTINGS)
    assert bytes((IAC, WILL, 44)) in port.opening()
    assert port.answers() == b""
    port.feed(bytes((IAC, DO, 44)))
    asked = port.answers()
    for command in ((1, 0, 0, 0x25, 0x80), (2, 7), (3, 3), (4, 1), (5, 1), (5, 8), (5, 11)):
        assert bytes((IAC, SB, 44, *command, IAC, SE)) in asked
    assert not port.settled
    assert port.feed(AGREED) == b""
    assert port.settled
    assert not port.refused


def test_a_server_that_keeps_another_rate_is_refused_with_both_rates():
    port = ComPort(SETTINGS)
    port.feed(bytes((IAC, DO, 44)) + answer(1, 0, 0, 0x4B, 0))
    assert (
        f"{port.refused}"
        == "the terminal server keeps baud 19200 instead of the requested 9600"
    )
    other = ComPort(SETTINGS)
    other.feed(bytes((IAC, DONT, 44)))
    assert "option 44 refused" in f"{other.refused}"


def test_what_is_offered_beyond_is_declined():
    port = ComPort(SETTINGS)
    port.feed(bytes((IAC, DO, 1, IAC, WILL, 1, IAC, WILL, 0, IAC, DO, 0)))
    assert port.answers() == bytes((IAC, WONT, 1, IAC, DONT, 1))


@given(data=st.binary(max_size=400), cuts=st.lists(st.integers(0, 900), max_size=9))
def test_data_come_through_unchanged_in_any_pieces_and_commands_between_them(data, cuts):
    whole = ComPort(SETTINGS)
    sent = bytes((IAC, DO, 44)) + whole.escaped(data) + AGREED + whole.escaped(data)
    assert b"".join(whole.feed(piece) for piece in pieces(sent, cuts)) == data + data
    assert whole.settled


@given(st.binary(max_size=2000))
def test_any_bytes_are_borne(data):
    port = ComPort(SETTINGS)
    assert len(port.feed(data)) <= len(data)


def test_ports_are_named_by_scheme_host_and_port():
    assert network_line("/dev/ttyUSB0") is None
    assert network_line("COM3") is None
    assert network_line("socket://10.0.0.7:4001") == NetworkLine("socket", "10.0.0.7", 4001)
    assert network_line("RFC2217://moxa-1.hall.example:7/") == NetworkLine(
        "rfc2217", "moxa-1.hall.example", 7
    )
    assert network_line("socket://[fe80::1%eth0]:1") == NetworkLine(
        "socket", "fe80::1%eth0", 1
    )


@pytest.mark.parametrize(
    "name",
    [
        "telnet://a:1",
        "socket://a",
        "socket://a:0",
        "socket://a:70000",
        "socket://:1",
        "socket://a b:1",
        "socket://",
    ],
)
def test_a_name_that_is_none_is_refused(name):
    with pytest.raises(
        UsageError, match=r"survey: laser\.port: expected a serial port, socket://host:port"
    ):
        network_line(name, "survey: laser.port")
