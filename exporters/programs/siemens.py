"""Siemens SINUMERIK 840D, 840D sl, 828D, ONE: metric part program."""

from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.signals import Signals


class Siemens(Dialect):
    """Part program in machine coordinates (``SUPA`` suppresses every offset of its block).

    The control and the PLC share the data words ``$A_DBW[n]`` (DB4900 on 828D: function manual
    6FC5397-0BP40-2BA0, 14.5.1.5). The control writes these data words while it prepares blocks;
    ``STOPRE`` delays the writing until the axes have arrived.
    """

    control = "siemens"
    title = "Siemens SINUMERIK"
    decimals = 4
    closing = ("M30",)
    signals = Signals(
        begin="STOPRE\n$A_DBW[4]=0\n$A_DBW[0]={setup}",
        stand="STOPRE\n$A_DBW[0]={setup}\n$A_DBW[2]={count}\n$A_DBW[4]=1",
        leave="STOPRE\n$A_DBW[4]=0",
        wait="STOPRE\nWHILE $A_DBW[6]<>{count}\nSTOPRE\nENDWHILE",
        end="STOPRE\n$A_DBW[0]=0",
    )
    needs = (
        (
            "plc: $A_DBW words 0 setup, 2 stop counter, 4 stopped (gate it with exact stop "
            "fine), 6 "
            "captured with handshake"
        ),
        "the builder says whether these words are free",
        (
            "828D: they are DB4900.DBW0 2 4 6, read over S7 by stepdiag itself. 840D sl: the user "
            "program calls FC 21 and copies"
        ),
        (
            "$A_DBW 0 2 4 into a data block of its own (words 0 2 4), with handshake its word 6 "
            "back "
            "to $A_DBW[6]"
        ),
    )

    checked = (
        (
            "SUPA leaves out every frame: G54, TRANS, ROT, CYCLE800, DRF. TRAFOOF ends a "
            "transformation"
        ),
        (
            "before the first move it stops by name where machine and basic position still differ: "
            "TRAORI, TRAANG, TRANSMIT left active"
        ),
        "it does not see where rotary axes and a swivelling head stand",
        (
            "read in the Programming Guide Advanced 04.00, page 15-559: $AA_IM is the machine "
            "position, $AA_IB the basic position"
        ),
    )

    def file_name(self, job: Job) -> str:
        return f"STEP_{job.word.upper()}.MPF"

    def comment(self, text: str) -> str:
        return f"; {text}"

    def start(self) -> list[str]:
        """Return the first blocks of the program, which set known modes without tool offset and
        transformation, and halt with a question on the screen.

        After every start the program compares the positions again, and continues only if they
        agree.
        """
        return [
            "G71 G90 G94 G17 G40 G60 G601",
            "D0",
            "TRAFOOF",
            "STEP_CHECK:",
            "STOPRE",
            "IF ABS($AA_IM[X]-$AA_IB[X])+ABS($AA_IM[Y]-$AA_IB[Y])+ABS($AA_IM[Z]-$AA_IB[Z])>0.003",
            'MSG("Stopped: machine and basic position differ, a transformation is active")',
            "M0",
            "GOTOB STEP_CHECK",
            "ENDIF",
            "M5",
            *self.ask("mirror on, beam returns, way to the first stop free?"),
        ]

    def ask(self, text: str) -> list[str]:
        return [f'MSG("{text[0].upper()}{text[1:]}")', "M0", "MSG()"]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        x, y, z = position
        return f"G1 SUPA X{x} Y{y} Z{z} F{feed}"

    def dwell(self, seconds: str) -> list[str]:
        return [f"G4 F{seconds}"]
