"""Heidenhain TNC (iTNC 530, TNC 620/640): conversational program, metric."""

from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.signals import Signals


class Heidenhain(Dialect):
    """Conversational blocks with ``M91``: coordinates of that block count from the machine datum.

    ``FN 19`` hands two numbers to the PLC; a counter of 0 means under way. ``FN 20: WAIT FOR SYNC`` holds the look-ahead back until
    the axes have arrived. There is no default for the handshake: its PLC operand is the builder's.
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
        "plc: FN 19 gives the setup and the stop counter. a counter of 0 means under way, any other stopped",
        "plc: gate stopped with the in-position signals, keep the last counter while under way (over LSV2 stepdiag does both)",
        "recalled, check in the manual: FN 20 WAIT FOR SYNC, and that FN 19 is not locked by a code number",
        "the tool length must be 0",
    )

    checked = (
        "M91 counts from the machine datum, whatever preset is active: machine and work position differ by it and are not compared",
        "before the first move it stops by name where the working plane is tilted, CYCLE 19, PLANE",
        "it does not see M128, TCPM, the tool length, or where a swivelling head stands",
        "recalled, check in the manual: FN 18 ID210 NR6 is the tilted plane, 0 without",
    )

    def file_name(self, job: Job) -> str:
        """Return the name of the program."""
        return f"STEP_{job.word.upper()}.H"

    def comment(self, text: str) -> str:
        """Return a comment block."""
        return f"; {text}"

    def start(self) -> list[str]:
        """Return the reset of datum shift, mirroring, rotation and scaling, the check of the tilted plane, and the halt."""
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
            "LBL 90",
            "FN 20: WAIT FOR SYNC",
            "FN 18: SYSREAD QL1 = ID210 NR6 IDX1",
            "FN 9: IF +QL1 EQU +0 GOTO LBL 91",
            "; stopped: the working plane is tilted, PLANE RESET first",
            "STOP M5",
            "FN 9: IF +0 EQU +0 GOTO LBL 90",
            "LBL 91",
            "; mirror on, beam returns, way to the first stop free?",
            "STOP M5",
        ]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        """Return a straight move from the machine datum, every coordinate with its sign."""
        x, y, z = (value if value.startswith("-") else f"+{value}" for value in position)
        return f"L X{x} Y{y} Z{z} R0 F{feed} M91"

    def dwell(self, seconds: str) -> list[str]:
        """Return the dwell cycle, in seconds."""
        return ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {seconds}"]
