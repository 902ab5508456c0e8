"""A reader of NC programs that knows nothing of the writer: it walks the blocks as the control
would and lists what happens.

Every block must be one that the dialect's table knows; the walk refuses anything else, moves before
the modes are known, and a signal that the control's look-ahead would send before the axes have
arrived.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Stand:
    """A dwell with ``stopped`` on: where, what the PLC is shown, for how long, and whether the
    captured counter was awaited."""

    position: Point
    setup: int
    count: int
    dwell_s: float
    waited: bool


class RefusedError(Exception):
    """The program stopped before its first move; the words are those on the control's screen."""


@dataclass
class Walk:
    """The state of the walk and what it has seen. ``left`` is what was active at the control
    before, by the control's own names."""

    left: Mapping[str, float] = field(default_factory=dict)

    stands: list[Stand] = field(default_factory=list)
    path: list[Point] = field(default_factory=list)
    feeds: set[float] = field(default_factory=set)
    comments: list[str] = field(default_factory=list)
    stand_comments: list[str] = field(default_factory=list)
    setup: int = 0
    count: int = 0
    stopped: bool = False
    dwelt_s: float = 0.0
    waited_for: int | None = None
    ahead: bool = False
    modes: set[str] = field(default_factory=set)
    halted: bool = False
    ended: bool = False
    checks: int = 0

    def read(self, name: str) -> float:
        """Return what the control holds under a name; 0 where nothing was left."""
        return self.left.get(name, 0.0)

    def refuse(self, when: bool, words: str) -> None:
        """Stop by name; nothing may have moved."""
        assert not self.path, "a check after the first move"
        assert not self.halted, "a check after the operator has agreed"
        self.checks += 1
        if when:
            raise RefusedError(words)

    def apart(self, one: str, other: str) -> float:
        """Return the sum of what two positions differ by in three axes; the names have a place for
        each."""
        return sum(
            abs(self.read(one.format(axis)) - self.read(other.format(axis)))
            for axis in (1, 2, 3)
        )

    def move(self, x: str, y: str, z: str, feed: str) -> None:
        assert not self.stopped, "moves while the PLC is told that the machine stands"
        assert self.halted, "moves before the operator has agreed"
        self.path.append((float(x), float(y), float(z)))
        self.feeds.add(float(feed))
        self.ahead = True

    def dwell(self, seconds: str) -> None:
        self.dwelt_s += float(seconds)
        self.ahead = True

    def barrier(self) -> None:
        self.ahead = False

    def signal(self, setup: int, count: int, stopped: bool) -> None:
        assert not self.ahead, "a signal that the look-ahead sends too early"
        if self.stopped and not stopped:
            self._leave()
        if stopped and not self.stopped:
            self.dwelt_s, self.waited_for = 0.0, None
        self.setup, self.count, self.stopped = setup, count, stopped

    def _leave(self) -> None:
        waited = self.waited_for is not None
        if waited:
            assert self.waited_for == self.count, (
                "waits for another stop than the one it stands at"
            )
        self.stands.append(Stand(self.path[-1], self.setup, self.count, self.dwelt_s, waited))
        self.stand_comments.append(self.comments[-1])


Rule = tuple[str, Callable[..., None]]
N = r"([-+]?\d+\.?\d*)"


def _fanuc(walk: Walk) -> list[Rule]:
    def word(setup: str, count: str | None) -> None:
        walk.signal(int(setup), int(count or 0), walk.stopped)

    def modes(text: str) -> None:
        walk.modes |= set(text.split())

    def move(*numbers: str) -> None:
        assert walk.modes >= {"G21", "G90", "G94", "G40", "G49", "G54", "5201", "5221"}, (
            walk.modes
        )
        assert all("." in number for number in numbers), (
            "without a point it counts in increments"
        )
        walk.move(*numbers)

    return [
        (r"\((.*)\)", walk.comments.append),
        (r"((?:G\d+ ?)*G21|G17 [G0-9 ]+|G54)", modes),
        (
            (
                r"IF\[\[ABS\[#(52\d1)\]\+ABS\[#52\d2\]\+ABS\[#52\d3\]\]NE0\]THEN #3000=\d\([A-Z0-9 "
                r"]+\)"
            ),
            modes,
        ),
        (
            r"IF\[FIX\[#(40\d\d)\]EQ(\d+)\]THEN #3000=\d\(([A-Z0-9. ]{1,26})\)",
            lambda group, code, words: walk.refuse(
                int(walk.read(f"#{group}")) == int(code), words
            ),
        ),
        (
            r"G53\nIF\[\[ABS\[#5021-#5041\]\+ABS\[#5022-#5042\]\+ABS\[#5023-#5043\]\]GT0\.003\]THEN #3000=\d\(([A-Z0-9. ]{1,26})\)",  # noqa: E501
            lambda words: walk.refuse(walk.apart("#502{}", "#504{}") > 0.003, words),
        ),
        (r"M05", lambda: None),
        (r"M00 \(.*\)", lambda: setattr(walk, "halted", True)),
        (r"G53", walk.barrier),
        (r"#1133=\[(\d+)\*65536(?:\+(\d+))?\]", word),
        (r"#1133=0", lambda: walk.signal(0, 0, walk.stopped)),
        (r"#1100=([01])", lambda bit: walk.signal(walk.setup, walk.count, bit == "1")),
        (rf"G09 G01 X{N} Y{N} Z{N} F{N}", move),
        (rf"G04 X{N}", walk.dwell),
        (
            r"WHILE\[#1032NE(\d+)\]DO1\nG53\nEND1",
            lambda count: setattr(walk, "waited_for", int(count)),
        ),
        (r"M30", lambda: setattr(walk, "ended", True)),
    ]


def _siemens(walk: Walk) -> list[Rule]:
    def word(index: str, value: str) -> None:
        shown = {"0": walk.setup, "2": walk.count, "4": int(walk.stopped)} | {
            index: int(value)
        }
        walk.signal(shown["0"], shown["2"], bool(shown["4"]))

    def move(*numbers: str) -> None:
        assert walk.modes >= {"G71", "G90", "G94", "G40", "G60", "D0"}, walk.modes
        walk.move(*numbers)

    apart = r"\+".join(rf"ABS\(\$AA_IM\[{axis}\]-\$AA_IB\[{axis}\]\)" for axis in "XYZ")
    return [
        (r"; (.*)", walk.comments.append),
        (r"(G71 [G0-9 ]+|D0)", lambda text: walk.modes.update(text.split())),
        (r"M5|MSG\(.*\)|TRAFOOF", lambda: None),
        (
            rf"(\w+):\nSTOPRE\nIF {apart}>0\.003\nMSG\(\"(.*)\"\)\nM0\nGOTOB \1\nENDIF",
            lambda _, words: walk.refuse(walk.apart("$AA_IM{}", "$AA_IB{}") > 0.003, words),
        ),
        (r"M0", lambda: setattr(walk, "halted", True)),
        (r"STOPRE", walk.barrier),
        (r"\$A_DBW\[(0|2|4)\]=(\d+)", word),
        (rf"G1 SUPA X{N} Y{N} Z{N} F{N}", move),
        (rf"G4 F{N}", walk.dwell),
        (
            r"WHILE \$A_DBW\[6\]<>(\d+)\nSTOPRE\nENDWHILE",
            lambda count: setattr(walk, "waited_for", int(count)),
        ),
        (r"M30", lambda: setattr(walk, "ended", True)),
    ]


def _heidenhain(walk: Walk) -> list[Rule]:
    def to_plc(setup: str, count: str) -> None:
        walk.signal(int(setup), int(count), int(count) > 0)

    def move(*numbers: str) -> None:
        assert walk.modes >= {"X+0", "Y+0", "Z+0", "ROT+0", "SCL 1"}, walk.modes
        assert all(number[0] in "+-" for number in numbers[:3]), (
            "coordinates carry their sign"
        )
        walk.move(*numbers)

    def compared(_again: str, place: str, expected: str, _on: str, words: str) -> None:
        walk.refuse(walk.left.get(place, float("NR4" in place)) != float(expected), words)

    read = (
        r"FN 20: WAIT FOR SYNC\nFN 18: SYSREAD QL1 = (ID\d+ NR\d+(?: IDX\d)?)\nFN 9: IF \+QL1 "
        r"EQU \+(\d)"
    )
    return [
        (r"; (.*)", walk.comments.append),
        (
            (
                r"CYCL DEF (?:7\.0 DATUM SHIFT|8\.0 MIRROR IMAGE|8\.1|10\.0 ROTATION|11\.0 "
                r"SCALING|9\.0 DWELL TIME)"
            ),
            lambda: None,
        ),
        (r"CYCL DEF (?:7\.[123]|10\.1|11\.1) (.*)", walk.modes.add),
        (
            (
                rf"LBL (\d+)\n{read} GOTO LBL (\d+)\n; (.*)\nSTOP M5\nFN 9: IF \+0 EQU \+0 GOTO "
                r"LBL "
                r"\1\nLBL \4"
            ),
            compared,
        ),
        (r"STOP M5", lambda: setattr(walk, "halted", True)),
        (r"FN 20: WAIT FOR SYNC", walk.barrier),
        (
            r"FN 20: WAIT FOR W100==(\d+)",
            lambda count: setattr(walk, "waited_for", int(count)),
        ),
        (r"FN 19: PLC=\+(\d+)/\+(\d+)", to_plc),
        (rf"L X{N} Y{N} Z{N} R0 F{N} M91", move),
        (rf"CYCL DEF 9\.1 DWELL {N}", walk.dwell),
        (r"M30", lambda: setattr(walk, "ended", True)),
    ]


def _linuxcnc(walk: Walk) -> list[Rule]:
    def analog(pin: str, value: str) -> None:
        shown = {"0": walk.setup, "1": walk.count} | {pin: int(value)}
        walk.barrier()  # M64, M65 and M68 wait for the moves before them
        walk.signal(shown["0"], shown["1"], walk.stopped)

    def digital(code: str) -> None:
        walk.barrier()
        walk.signal(walk.setup, walk.count, code == "4")

    def move(*numbers: str) -> None:
        assert walk.modes >= {"G21", "G90", "G94", "G40", "G49", "G61.1"}, walk.modes
        walk.move(*numbers)

    return [
        (r"\(MSG,.*\)|M5", lambda: None),
        (r"\((.*)\)", walk.comments.append),
        (r"(G21 [G0-9. ]+)", lambda text: walk.modes.update(text.split())),
        (r"M0", lambda: setattr(walk, "halted", True)),
        (r"M68 E([01]) Q(\d+)", analog),
        (r"M6([45]) P0", digital),
        (rf"G53 G1 X{N} Y{N} Z{N} F{N}", move),
        (rf"G4 P{N}", walk.dwell),
        (
            r"M66 E0 L0\no\d+ while \[#5399 NE (\d+)\]\nG4 P0\.02\nM66 E0 L0\no\d+ endwhile",
            lambda count: setattr(walk, "waited_for", int(count)),
        ),
        (r"M2", lambda: setattr(walk, "ended", True)),
    ]


RULES = {
    "fanuc": _fanuc,
    "siemens": _siemens,
    "heidenhain": _heidenhain,
    "linuxcnc": _linuxcnc,
}


def walk_program(data: bytes, control: str, left: Mapping[str, float] | None = None) -> Walk:
    """Return what the program does where some things were ``left`` active at the control.

    Raises AssertionError for a block that the dialect does not know, RefusedError where the program
    stops by name.
    """
    text = _unframed(data.decode("ascii"), control)
    walk = Walk(left or {})
    rules = [
        (re.compile(rf"(?:{pattern})(?:\n|\Z)"), action)
        for pattern, action in RULES[control](walk)
    ]
    at = 0
    while at < len(text):
        assert not walk.ended, f"blocks after the end: {text[at : at + 40]!r}"
        for pattern, action in rules:
            if match := pattern.match(text, at):
                action(*match.groups())
                at = match.end()
                break
        else:
            raise AssertionError(f"unknown block: {text[at:].splitlines()[0]!r}")
    assert walk.ended, "the program does not end"
    assert walk.setup == 0, "the setup register is left on"
    return walk


def _unframed(text: str, control: str) -> str:
    """Return the blocks alone, one a line: line ends, file frame and block numbers checked and
    taken off."""
    newline = "\n" if control == "linuxcnc" else "\r\n"
    assert text.endswith(newline)
    assert text.count("\n") == text.count(newline)
    lines = text.split(newline)[:-1]
    if control == "fanuc":
        assert (lines[0], lines[-1]) == ("%", "%")
        assert re.fullmatch(r"O\d{4}", lines[1])
        assert re.fullmatch(r"[A-Z0-9 %()\[\]#=.,*+/<>-]*", "".join(lines)), (
            "letters that the control does not read"
        )
        lines = lines[2:-1]
    if control == "heidenhain":
        assert [line.split(" ", 1)[0] for line in lines] == [
            str(number) for number in range(len(lines))
        ]
        lines = [line.split(" ", 1)[1] for line in lines]
        assert re.fullmatch(r"BEGIN PGM \w+ MM", lines[0])
        assert lines[-1] == lines[0].replace("BEGIN", "END")
        lines = lines[1:-1]
    return "\n".join(lines)
