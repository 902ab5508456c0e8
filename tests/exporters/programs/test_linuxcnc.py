"""What is written for LinuxCNC beside the programs: the HAL component speaks Modbus as its
docstring says, whatever is sent to it.

It runs beside stand-ins for the control's two Python modules (`testkit.component`);
`tests/system/control` has the real ones.
"""

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.exporters.programs import CONTROLS, companion_files
from testkit.component import COMPONENT


class Pins(dict):
    """HAL pins as the component uses them."""


@pytest.fixture(scope="module")
def served() -> tuple[Pins, int]:
    """Serve pins on a real socket; return them and the port."""
    pins = Pins(
        {
            "setup": 2.0,
            "count": 65537.0,
            "stopped": True,
            "in-position": True,
            "captured": 0.0,
            **COMPONENT.USUAL,
        }
    )
    pins |= {"position-x": -200.0, "position-y": 0.00005, "position-z": 1e9}
    door = socket.create_server(("127.0.0.1", 0))
    threading.Thread(
        target=COMPONENT.served, args=(door, COMPONENT.Block(pins, 1.0)), daemon=True
    ).start()
    return pins, door.getsockname()[1]


@contextmanager
def asked(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=10.0) as link:
        yield link


def exchange(link: socket.socket, request: bytes, number: int = 7, unit: int = 1) -> bytes:
    """Send a request and return the reply without its head, which must be the request's."""
    link.sendall(struct.pack(">HHHB", number, 0, len(request) + 1, unit) + request)
    head = _exactly(link, 7)
    assert struct.unpack(">HH", head[:4]) == (number, 0)
    assert head[6] == unit
    return _exactly(link, struct.unpack(">H", head[4:6])[0] - 1)


def _exactly(link: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += link.recv(count - len(data)) or pytest.fail("closed")
    return data


class TestBlock:
    def test_shows_what_the_program_says(self, served: tuple[Pins, int]) -> None:
        """Contract 2: counter wrapped, bits, setup, positions in 0.1 µm high word first and held at
        the ends, the hall's usual values."""
        with asked(served[1]) as link:
            reply = exchange(link, struct.pack(">BHH", 3, 0, 14))
        words = struct.unpack(">14H", reply[2:])
        assert words[1:4] == (1, 0b011, 2)
        assert struct.unpack(">3i", reply[2 + 8 : 2 + 20]) == (-2_000_000, 0, 2**31 - 1)
        assert words[10:] == (2000, 2000, 10132, 500)

    @pytest.mark.parametrize(
        ("stopped", "in_position", "bit"),
        [(True, True, 1), (True, False, 0), (False, True, 0)],
    )
    def test_is_stopped_only_in_position(
        self, served: tuple[Pins, int], stopped: bool, in_position: bool, bit: int
    ) -> None:
        pins, port = served
        pins["stopped"], pins["in-position"] = stopped, in_position
        with asked(port) as link:
            reply = exchange(link, struct.pack(">BHH", 4, 2, 1))
        pins["stopped"] = pins["in-position"] = True
        assert struct.unpack(">H", reply[2:])[0] & 1 == bit

    @pytest.mark.parametrize(("state", "bit"), [(1, 0), (2, 1), (3, 1)])
    def test_is_stopped_only_while_a_program_runs(self, state: int, bit: int) -> None:
        """The output stays set where a program was aborted at a stop: the jog that follows would
        count as this stop."""
        status = COMPONENT.linuxcnc.stat()
        pins = {
            "setup": 1.0,
            "count": 3.0,
            "stopped": True,
            "in-position": True,
            **COMPONENT.USUAL,
        }
        pins |= {f"position-{axis}": 0.0 for axis in "xyz"}
        status.interp_state, before = state, status.interp_state
        try:
            assert COMPONENT.Block(pins, 1.0).registers()[2] & 1 == bit
        finally:
            status.interp_state = before

    @pytest.mark.parametrize(
        "request_",
        [struct.pack(">BHH", 6, 100, 41), struct.pack(">BHHBH", 16, 100, 1, 2, 41)],
    )
    def test_takes_the_answer_of_the_handshake(
        self, served: tuple[Pins, int], request_: bytes
    ) -> None:
        pins, port = served
        pins["captured"] = 0.0
        with asked(port) as link:
            assert exchange(link, request_) == request_[:5]
        assert pins["captured"] == 41.0

    @pytest.mark.parametrize(
        ("request_", "code"),
        [
            (struct.pack(">BHH", 3, 0, 15), 2),
            (struct.pack(">BHH", 3, 65535, 1), 2),
            (struct.pack(">BHH", 3, 0, 0), 3),
            (struct.pack(">BHH", 3, 0, 126), 3),
            (struct.pack(">BHH", 6, 0, 1), 2),
            (struct.pack(">BHH", 6, 101, 1), 2),
            (struct.pack(">BHHBHH", 16, 99, 2, 4, 1, 2), 2),
            (struct.pack(">BHH", 5, 0, 0xFF00), 1),
            (b"\x03", 1),
            (b"\x2b\x0e\x01\x00", 1),
        ],
    )
    def test_refuses_everything_else_and_writes_nothing(
        self, served: tuple[Pins, int], request_: bytes, code: int
    ) -> None:
        pins, port = served
        before = dict(pins)
        with asked(port) as link:
            assert exchange(link, request_) == bytes([request_[0] | 0x80, code])
        assert dict(pins) == before


class TestConnections:
    def test_pieces_of_any_size_give_the_same_answers(self, served: tuple[Pins, int]) -> None:
        frame = struct.pack(">HHHBBHH", 9, 0, 6, 1, 3, 1, 3)
        with asked(served[1]) as link:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for byte in frame + frame:
                link.sendall(bytes([byte]))
            first, second = _exactly(link, 15), _exactly(link, 15)
        assert first == second

    @settings(
        max_examples=60,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
    @given(noise=st.binary(min_size=1, max_size=400))
    def test_whatever_is_sent_the_next_one_is_served(
        self, served: tuple[Pins, int], noise: bytes
    ) -> None:
        with asked(served[1]) as stranger, asked(served[1]) as link:
            stranger.sendall(noise)
            assert exchange(link, struct.pack(">BHH", 3, 1, 1))[:2] == b"\x03\x02"

    def test_the_oldest_of_too_many_gives_way(self, served: tuple[Pins, int]) -> None:
        links = [
            socket.create_connection(("127.0.0.1", served[1]), timeout=10.0)
            for _ in range(COMPONENT.MOST_CLIENTS + 3)
        ]
        try:
            assert exchange(links[-1], struct.pack(">BHH", 3, 1, 1))[:2] == b"\x03\x02"
            assert links[0].recv(1) == b""
        finally:
            for link in links:
                link.close()


class TestFiles:
    def test_only_a_control_without_plc_gets_them(self) -> None:
        assert [control for control in CONTROLS if companion_files(control)] == ["linuxcnc"]

    def test_the_hal_file_serves_where_the_survey_asks(self) -> None:
        component, hal = companion_files("linuxcnc", "192.168.1.20", 1502)
        text = hal.data.decode()
        assert f"./{component.name} --host 192.168.1.20 --port 1502\n" in text
        pins = {
            line.split()[-1].removeprefix("stepdiag.")
            for line in text.splitlines()
            if line.startswith("net ")
        }
        assert pins == {
            "setup",
            "count",
            "stopped",
            "in-position",
            "position-x",
            "position-y",
            "position-z",
            "captured",
        }

    @pytest.mark.parametrize("host", ["", "a b", "x\nloadrt evil", "$(reboot)", "a;b"])
    def test_an_address_that_is_none_is_refused(self, host: str) -> None:
        with pytest.raises(UsageError, match=r"plc\.host"):
            companion_files("linuxcnc", host)
