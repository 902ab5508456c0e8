"""The register block that the component for LinuxCNC serves: what it shows of a control, and what
it answers to every request."""

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any, Self
from unittest.mock import patch

from testkit.component import COMPONENT

SHOWN = {
    "setup": 2.0,
    "count": 65537.0,
    "stopped": True,
    "in-position": True,
    "captured": 0.0,
    "position-x": -200.12345,
    "position-y": 0.0002,
    "position-z": 3.5,
    "material-c": 21.37,
    "air-c": -4.25,
    "pressure-hpa": 987.64,
    "humidity-percent": 43.2,
}
READ = struct.pack(">HHHBBHH", 9, 0, 6, 1, 3, 1, 2)
"""A whole frame that asks for registers 1 and 2."""


class RefusedError(Exception):
    """The control's own error."""


class EndError(Exception):
    """The control ends the component."""


class Control:
    """A control whose state a case sets; it counts how often it is asked."""

    INTERP_IDLE, STATE_ON, error = 1, 4, RefusedError

    def __init__(self) -> None:
        (
            self.interp_state,
            self.task_state,
            self.asked,
            self.fails,
            self.absent,
            self.units,
        ) = (
            2,
            4,
            0,
            False,
            False,
            {},
        )

    def stat(self) -> "Control":
        if self.absent:
            raise RefusedError
        return self

    def poll(self) -> None:
        self.asked += 1
        if self.fails:
            raise RefusedError

    def ini(self, path: str) -> Any:
        return SimpleNamespace(
            find=lambda section, name: self.units.get(f"{path} {section} {name}")
        )


class Link:
    """One end of a connection: what comes in piece by piece (an exception is raised), and what went
    out."""

    def __init__(self, *pieces: Any, takes: int = 99) -> None:
        self.pieces, self.takes, self.sent, self.closed = list(pieces), takes, [], False

    def recv(self, size: int) -> bytes:
        assert size >= COMPONENT.LONGEST_FRAME
        piece = self.pieces.pop(0)
        if isinstance(piece, Exception):
            raise piece
        return piece

    def sendall(self, data: bytes) -> None:
        if len(self.sent) >= self.takes:
            raise BrokenPipeError
        self.sent.append(data.hex(" "))

    def setblocking(self, flag: bool) -> None:
        self.blocking = flag

    def setsockopt(self, *option: int) -> None:
        self.option = option

    def close(self) -> None:
        self.closed = True


@contextmanager
def beside(control: Control, at_s: Sequence[float] = ()) -> Iterator[None]:
    """Run the component beside a control, on a clock that says one time after another, the last for
    ever."""
    times = list(at_s) or [1.0]
    clock = SimpleNamespace(monotonic=lambda: times.pop(0) if len(times) > 1 else times[0])
    with patch.multiple(COMPONENT, linuxcnc=control, time=clock):
        yield


def block(unit_mm: float = 1.0, **pins: Any) -> Any:
    return COMPONENT.Block(
        {**SHOWN, **{name.replace("_", "-"): value for name, value in pins.items()}}, unit_mm
    )


def cases() -> dict[str, Callable[[], Any]]:
    """Return what is asked of the component, by its name."""
    return {
        "shown": _shown,
        "looked": _looked,
        "answered": _answered,
        "links": _links,
        "clients": _clients,
        "offered": _offered,
    }


def _shown() -> Any:
    """The registers of pins at their usual values and at the ends of what a register holds."""
    found: dict[str, Any] = {}

    def of(
        name: str,
        unit_mm: float = 1.0,
        at_s: float = 1.0,
        control: Control | None = None,
        **pins: Any,
    ) -> None:
        with beside(control or Control(), [at_s]):
            found[name] = block(unit_mm, **pins).registers()

    of("plain")
    of("inch", 25.4)
    for bits in ((True, False), (False, True), (False, False)):
        of(f"stopped {bits[0]}, in position {bits[1]}", stopped=bits[0], in_position=bits[1])
    for at_s in (0.0, 0.3, 0.41, 1.21, 26213.9, 26214.5, 26215.0):
        of(f"{at_s} s", at_s=at_s)
    for count in (0.0, 1.4, 1.6, 65535.0, 65536.0, 131073.0):
        of(f"count {count}", count=count, setup=count)
    for mm in (
        214748.3647,
        214748.3649,
        300000.0,
        -214748.3648,
        -214748.365,
        -300000.0,
        6.5536,
        -0.0001,
        0.00004,
    ):
        of(f"at {mm} mm", position_x=mm, position_y=-mm, position_z=mm)
    of("cold", material_c=-0.01, air_c=-300.0, pressure_hpa=6553.5, humidity_percent=-0.1)
    of("hot", material_c=655.35, air_c=655.36, pressure_hpa=6553.6, humidity_percent=0.04)
    for interp, task in ((1, 4), (1, 3), (2, 3), (3, 1)):
        control = Control()
        control.interp_state, control.task_state = interp, task
        of(f"interpreter {interp}, task {task}", control=control)
    return found


def _looked() -> Any:
    """How often the control is asked, and what is shown while it is not there."""
    found: dict[str, Any] = {}
    for name, times in {
        "at once": (0.0625, 0.0625, 0.0625),
        "before": (0.0312, 0.0312),
        "late": (1.0, 1.0, 1.0, 1.03, 1.03),
    }.items():
        control = Control()
        with beside(control, times):
            own = block()
            found[name] = [
                own.registers()[2],
                control.asked,
                own.registers()[2],
                control.asked,
            ]
    for after in (0.0, 0.01, 0.05, 0.0625, 1.0):
        control = Control()
        control.task_state = 1
        with beside(control, [0.25, 0.25, 0.25, 0.25 + after]):
            own = block()
            before = own.registers()[2]
            control.task_state, control.interp_state = 4, 1
            found[f"again after {after} s"] = [before, own.registers()[2], control.asked]
    for what in ("fails", "absent"):
        control = Control()
        setattr(control, what, True)
        with beside(control, [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0]):
            own = block()
            before = own.registers()[2]
            setattr(control, what, False)
            between = own.registers()[2]
            setattr(control, what, True)
            found[what] = [before, between, own.registers()[2], control.asked]
    return found


def _answered() -> Any:
    """Requests of every function, length and address: the answers, and what was taken of them."""
    requests = [struct.pack(">BHH", function, 0, 3) for function in range(24)]
    requests += [
        struct.pack(">BHH", 0x83, 0, 3),
        b"\x00",
        b"\x03",
        b"\x06",
        b"\x10",
        b"\x2b\x0e\x01\x00",
    ]
    requests += [
        struct.pack(">BHH", 3, first, count)
        for first in (0, 1, 2, 13, 14, 15, 99, 100, 65535)
        for count in (0, 1, 12, 13, 14, 15)
    ]
    requests += [
        struct.pack(">BHH", 4, first, count)
        for first in (0, 20)
        for count in (124, 125, 126, 127, 65535)
    ]
    requests += [struct.pack(">BHH", 6, number, 41) for number in (0, 13, 99, 100, 101, 356)]
    requests += [struct.pack(">BHH", 6, 100, value) for value in (0, 1, 255, 256, 65535)]
    requests += [struct.pack(">BHHBH", 16, number, 1, 2, 515) for number in (0, 99, 100, 101)]
    requests += [
        struct.pack(">BHHBH", 16, 100, *head, 7)
        for head in ((0, 2), (2, 2), (257, 2), (1, 1), (1, 3), (1, 4))
    ]
    requests += [struct.pack(">BHHBHH", 16, 100, 2, 4, 1, 2)]
    found: dict[str, Any] = {}
    for request in requests:
        for size in (len(request), len(request) - 1, len(request) + 1):
            asked = (request + b"\x01")[:size]
            if not asked:
                continue
            pins = dict(SHOWN)
            with beside(Control()):
                reply = COMPONENT.answer(asked, COMPONENT.Block(pins, 1.0))
            took = pins["captured"]
            found[asked.hex(" ")] = reply.hex(" ") + (
                f", captured {took:g}" if pins != SHOWN else ""
            )
    return found


def _links() -> Any:
    """Connections: pieces of requests, foreign protocols, ends."""

    def frame(protocol: int = 0, length: int = 6, more: bytes = b"") -> bytes:
        return (
            struct.pack(">HHHB", 258, protocol, length, 17)
            + (struct.pack(">BHH", 3, 1, 2) + more)[: max(length - 1, 0)]
        )

    states: dict[str, Link] = {
        "whole": Link(READ),
        "two at once": Link(READ + frame()),
        "in pieces": Link(
            READ[:5], READ[5:7], READ[7:8], READ[8:11], READ[11:] + READ[:3], READ[3:]
        ),
        "ended": Link(b""),
        "ended with a rest": Link(READ[:9], b""),
        "nothing now": Link(BlockingIOError(), READ),
        "broken": Link(OSError()),
        "no answer taken": Link(READ, takes=0),
        "one answer taken": Link(READ + READ, takes=1),
        **{f"protocol {protocol}": Link(frame(protocol)) for protocol in (1, 256)},
        **{
            f"length {length}": Link(frame(length=length, more=b"\0" * 300))
            for length in (0, 1, 2, 3, 6, 259, 260, 261)
        },
        "length announced": Link(frame(length=260)[:8], READ),
        "two wrong": Link(frame(1), READ),
    }
    found = {}
    for name, link in states.items():
        client, stays = COMPONENT.Client(link), []
        with beside(Control()):
            while link.pieces:
                stays.append(client.serve(block()))
        found[name] = [stays, link.sent]
    return found


def _clients() -> Any:
    """Connections that come and go, and the ninth."""

    def of(*turns: tuple[bool, Sequence[int]], links: Sequence[Link]) -> Any:
        """Serve: each turn says whether somebody knocks, and which connections have something to
        say."""
        waiting, left, looked = list(links), list(turns), []

        class Door:
            def accept(self) -> tuple[Link, str]:
                return waiting.pop(0), "somebody"

        door = Door()

        def select(
            read: list[Any], write: list[Any], wrong: list[Any]
        ) -> tuple[list[Any], list[Any], list[Any]]:
            looked.append(
                [links.index(one) if one in links else "door" for one in read] + write + wrong
            )
            if not left:
                raise EndError
            knocks, speaking = left.pop(0)
            return (
                [*([door] if knocks else []), *(links[number] for number in speaking)],
                [],
                [],
            )

        with (
            beside(Control()),
            patch.object(COMPONENT, "select", SimpleNamespace(select=select)),
            suppress(EndError),
        ):
            COMPONENT.served(door, block())
        return [
            looked,
            [
                [
                    len(one.sent),
                    one.closed,
                    getattr(one, "blocking", None),
                    *getattr(one, "option", ()),
                ]
                for one in links
            ],
        ]

    many = COMPONENT.MOST_CLIENTS
    return {
        "one": of((True, []), (False, [0]), (False, [0]), links=[Link(READ, b"")]),
        "two": of(
            (True, []),
            (True, [0]),
            (False, [1, 0]),
            (False, [1]),
            links=[Link(READ, b""), Link(READ, READ)],
        ),
        "as many as may": of(*[(True, [])] * many, links=[Link() for _ in range(many)]),
        "one too many": of(
            *[(True, [])] * (many + 1),
            (False, [1]),
            links=[Link(), *(Link(READ) for _ in range(many))],
        ),
        "two too many": of(
            *[(True, [])] * (many + 2), links=[Link() for _ in range(many + 2)]
        ),
        "one goes as one comes": of(
            *[(True, [])] * many,
            (True, [0]),
            links=[Link(b""), *(Link() for _ in range(many))],
        ),
        "the second goes": of(
            *[(True, [])] * many,
            (True, [1]),
            (True, []),
            links=[Link(b"") for _ in range(many + 2)],
        ),
    }


def _offered() -> Any:
    """The pins, the unit, and how the component begins and ends."""

    class Pins(dict):
        def __init__(self, name: str) -> None:
            super().__init__()
            self.told: list[Any] = [name]

        def newpin(self, *pin: Any) -> None:
            self.told.append(list(pin))

        def ready(self) -> None:
            self.told.append("ready")

        def exit(self) -> None:
            self.told.append("exit")

    made: list[Pins] = []

    def component(name: str) -> Pins:
        made.append(Pins(name))
        return made[-1]

    hal = SimpleNamespace(
        component=component, HAL_FLOAT="float", HAL_IN="in", HAL_BIT="bit", HAL_OUT="out"
    )
    found: dict[str, Any] = {}
    with patch.object(COMPONENT, "hal", hal):
        pins = COMPONENT.wired()
        found["pins"] = [pins.told, dict(pins)]
        control = Control()
        for unit in (None, "mm", "MM", "inch", "INCH", "in", "imperial", "metric", ""):
            control.units = {"a.ini TRAJ LINEAR_UNITS": unit}
            with (
                beside(control),
                patch.object(
                    COMPONENT, "os", SimpleNamespace(environ={"INI_FILE_NAME": "a.ini"})
                ),
            ):
                found[f"unit {unit}"] = COMPONENT.inches()
                found[f"{unit}, begun"] = _begun(made, inches=COMPONENT.inches())
        with beside(control), patch.object(COMPONENT, "os", SimpleNamespace(environ={})):
            found["no ini"] = COMPONENT.inches()
        found["begun elsewhere"] = _begun(made, "--host", "10.0.0.1", "--port", "502")
    return found


def _begun(made: Sequence[Any], *words: str, inches: bool = False) -> Any:
    """Return what the component does from its start to its end."""
    told: list[Any] = []

    class Door:
        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            told.append("closed")

        def __getattr__(self, name: str) -> Callable[..., None]:
            return lambda *values: told.append([name, *values])

    def served(door: Door, own: Any) -> None:
        told.append(["served", own._unit_mm, own._pins is made[-1], door.__class__.__name__])
        raise EndError

    def ends(number: int, act: Callable[..., None]) -> None:
        try:
            act(number, None)
        except SystemExit as end:
            told.append(["ends by", number, end.code])

    sockets = SimpleNamespace(socket=Door, SOL_SOCKET=1, SO_REUSEADDR=2)
    with (
        patch.multiple(
            COMPONENT,
            sys=SimpleNamespace(exit=COMPONENT.sys.exit),
            socket=sockets,
            signal=SimpleNamespace(signal=ends, SIGTERM=15),
            inches=lambda: inches,
            served=served,
        ),
        patch("sys.argv", ["stepdiag_modbus.py", *words]),
    ):
        try:
            COMPONENT.main()
        except EndError:
            told.append("ended")
    return [told, made[-1].told[-2:]]
