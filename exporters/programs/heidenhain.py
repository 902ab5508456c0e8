"""Heidenhain TNC (iTNC 530, TNC 620/640): conversational program, metric."""

from dataclasses import dataclass

from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.signals import Signals


@dataclass(frozen=True, slots=True)
class _Check:
    """A value of the control (``FN 18``) that the program compares before its first move.

    Source of the numbers of the values: HEIDENHAIN, Technical Manual TNC 426 / TNC 430, page
    7-30.
    """

    place: str
    expected: int
    stopped: str

    def blocks(self, label: int) -> list[str]:
        """Return the NC blocks that compare the value with ``expected``. If the two differ, the
        program stops, and compares them again after the start key.
        """
        return [
            f"LBL {label}",
            "FN 20: WAIT FOR SYNC",
            f"FN 18: SYSREAD QL1 = {self.place}",
            f"FN 9: IF +QL1 EQU +{self.expected} GOTO LBL {label + 1}",
            f"; stopped: {self.stopped}",
            "STOP M5",
            f"FN 9: IF +0 EQU +0 GOTO LBL {label}",
            f"LBL {label + 1}",
        ]


_CHECKS = (
    _Check("ID210 NR6", 0, "the working plane is tilted, PLANE RESET first"),
    _Check("ID280 NR1", 0, "M128 is active, M129 first"),
    _Check("ID210 NR2", 0, "a rotation is active, reset cycle 10 first"),
    _Check("ID210 NR3", 0, "a mirror image is active, reset cycle 8 first"),
    *(
        _Check(f"ID210 NR4 IDX{axis}", 1, "a scaling is active, reset cycle 11 first")
        for axis in (1, 2, 3)
    ),
)


class Heidenhain(Dialect):
    """The conversational dialect. With ``M91`` the coordinates of a block count from the machine
    datum.

    ``FN 19`` sends two numbers (setup and stop count) to the PLC; a stop count of 0 means that the
    machine moves. ``FN 20: WAIT FOR SYNC`` delays the look-ahead until the axes have arrived. The
    handshake has no default text, because its PLC operand depends on the builder of the machine.
    """

    control = "heidenhain"
    title = "Heidenhain TNC"
    decimals = 4
    opening = ("BEGIN PGM {stem} MM",)
    closing = ("M30", "END PGM {stem} MM")
    numbered = True
    signals = Signals(
        begin="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+0",
        stand="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+{count}",
        leave="FN 20: WAIT FOR SYNC\nFN 19: PLC=+{setup}/+0",
        wait="",
        end="FN 20: WAIT FOR SYNC\nFN 19: PLC=+0/+0",
    )
    needs = (
        (
            "plc: FN 19 gives the setup and the stop counter. a counter of 0 means under way, any "
            "other stopped"
        ),
        (
            "plc: gate stopped with the in-position signals, keep the last counter while under way "
            "(over LSV2 stepdiag does both)"
        ),
        (
            "recalled, check in the manual: FN 20 WAIT FOR SYNC, and that FN 19 is not locked by a "
            "code number"
        ),
        "the tool length must be 0",
    )

    checked = (
        (
            "M91 counts from the machine datum, whatever preset is active: machine and work "
            "position "
            "differ by it and are not compared"
        ),
        (
            "before the first move it resets cycles 7, 8, 10 and 11, and stops by name where a "
            "rotation, a mirror image, a scaling,"
        ),
        "the tilted working plane (CYCLE 19, PLANE) or M128 is active then",
        (
            "it does not see a basic rotation, cycle 26, the tool length, or where a swivelling "
            "head "
            "stands"
        ),
        (
            "read in the technical manual of TNC 426 and 430, page 7-30: ID210 and ID280 of FN 18; "
            "check it for another version"
        ),
    )

    def file_name(self, job: Job) -> str:
        return f"STEP_{job.word.upper()}.H"

    def comment(self, text: str) -> str:
        return f"; {text}"

    def start(self) -> list[str]:
        """Return the first blocks of the program, which reset datum shift, mirroring, rotation and
        scaling, check that none of these is active, and halt.
        """
        return [
            "CYCL DEF 7.0 DATUM SHIFT",
            "CYCL DEF 7.1 X+0",
            "CYCL DEF 7.2 Y+0",
            "CYCL DEF 7.3 Z+0",
            "CYCL DEF 8.0 MIRROR IMAGE",
            "CYCL DEF 8.1",
            "CYCL DEF 10.0 ROTATION",
            "CYCL DEF 10.1 ROT+0",
            "CYCL DEF 11.0 SCALING",
            "CYCL DEF 11.1 SCL 1",
            *(
                block
                for number, check in enumerate(_CHECKS)
                for block in check.blocks(90 + 2 * number)
            ),
            *self.ask("mirror on, beam returns, way to the first stop free?"),
        ]

    def ask(self, text: str) -> list[str]:
        return [self.comment(text), "STOP M5"]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        x, y, z = (value if value.startswith("-") else f"+{value}" for value in position)
        return f"L X{x} Y{y} Z{z} R0 F{feed} M91"

    def dwell(self, seconds: str) -> list[str]:
        return ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {seconds}"]
