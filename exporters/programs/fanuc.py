"""Fanuc (16i/18i/21i, 0i, 30i family), custom macro B, metric."""

from stepdiag.exporters.programs.dialect import Dialect, Job, plain
from stepdiag.exporters.programs.signals import Signals


class Fanuc(Dialect):
    """ISO code with macro statements.

    The control executes macro statements as soon as it reads them ahead. ``G53`` alone on a block
    delays the macro statements after it until the axes have arrived (B-63614EN/01, p. 322). ``G09``
    ends the move in an exact stop.
    """

    control = "fanuc"
    title = "Fanuc"
    opening = ("%", "{stem}")
    closing = ("M30", "%")
    signals = Signals(
        begin="G53\n#1100=0\n#1133=[{setup}*65536]",
        stand="G53\n#1133=[{setup}*65536+{count}]\n#1100=1",
        leave="G53\n#1100=0",
        wait="WHILE[#1032NE{count}]DO1\nG53\nEND1",
        end="G53\n#1133=0",
    )
    needs = (
        "plc: 1100 bit 0 is stopped. gate it with the in-position signals",
        "plc: 1133 upper 16 bits are the setup, lower 16 bits the stop counter",
        "plc: 1032 is the captured counter, only with handshake",
        (
            "recalled, check in the connection manual: 1133 is a free 32 bit output, 5201 and 5221 "
            "are the EXT and G54 offsets"
        ),
    )

    checked = (
        (
            "before the first move it stops by name where work and machine position differ, an "
            "offset, G52, G92,"
        ),
        "or where a rotation, G68, a scaling, G51, or a mirror image, G51.1, is active",
        (
            "it does not see a tilt of the head. recalled, check in the manual: 5021 machine and "
            "5041 work position of axes 1 to 3,"
        ),
        "4011, 4016 and 4022 the modal codes of scaling, rotation and mirror image",
    )

    def file_name(self, job: Job) -> str:
        return f"O{job.program_number}"

    def comment(self, text: str) -> str:
        """Return a comment block. Characters with another meaning are replaced: in ISO code a colon
        is the letter O.
        """
        return f"({text.upper().replace(':', ' -').replace('_', '-')})"

    def number(self, value: float) -> str:
        """Return the text of a number with a decimal point. A number without a point counts in
        input increments.
        """
        text = plain(value)
        return text if "." in text else text + "."

    def start(self) -> list[str]:
        """Return the first blocks of the program, which set known modes, refuse any offset,
        rotation, scaling and mirror image, and halt.

        ``G53`` alone on a block delays the reading of the positions until the axes have arrived. A
        comparison of the positions shows a shift, but no rotation. The modal code of the rotation
        is read instead.
        """
        return [
            "G21",
            "G17 G40 G49 G80 G90 G94",
            "G54",
            "IF[[ABS[#5201]+ABS[#5202]+ABS[#5203]]NE0]THEN #3000=1(EXT OFFSET NOT ZERO)",
            "IF[[ABS[#5221]+ABS[#5222]+ABS[#5223]]NE0]THEN #3000=2(G54 OFFSET NOT ZERO)",
            "IF[FIX[#4016]EQ68]THEN #3000=3(G68 ROTATION IS ACTIVE)",
            "IF[FIX[#4011]EQ51]THEN #3000=4(G51 SCALING IS ACTIVE)",
            "IF[FIX[#4022]EQ51]THEN #3000=5(G51.1 MIRROR IS ACTIVE)",
            "G53",
            (
                "IF[[ABS[#5021-#5041]+ABS[#5022-#5042]+ABS[#5023-#5043]]GT0.003]THEN "
                "#3000=6(WORK IS "
                "NOT MACHINE POS)"
            ),
            "M05",
            *self.ask("mirror on, beam returns, way to the first stop free"),
        ]

    def ask(self, text: str) -> list[str]:
        return [f"M00 {self.comment(text)}"]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        """Return the block of a move at feed in machine coordinates. The move uses G54 set to zero,
        because G53 moves only in rapid.
        """
        x, y, z = position
        return f"G09 G01 X{x} Y{y} Z{z} F{feed}"

    def dwell(self, seconds: str) -> list[str]:
        return [f"G04 X{seconds}"]
