"""LinuxCNC: metric RS274/NGC program. This control has no PLC; a HAL component takes its place."""

import re
from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.signals import Signals

COMPONENT = "stepdiag_modbus.py"
HAL = "stepdiag.hal"
_ADDRESS = re.compile(r"[A-Za-z0-9.:-]{1,100}")
_NETS = (
    ("setup", "motion.analog-out-00", "=>"),
    ("count", "motion.analog-out-01", "=>"),
    ("stopped", "motion.digital-out-00", "=>"),
    ("in-position", "motion.in-position", "=>"),
    *((f"position-{axis}", f"axis.{axis}.pos-cmd", "=>") for axis in "xyz"),
    ("captured", "motion.analog-in-00", "<="),
)


class LinuxCNC(Dialect):
    """The RS274/NGC dialect in machine coordinates (``G53`` with each move).

    ``M64``, ``M65`` and ``M68`` are executed after the moves before them have ended; ``G61.1`` ends
    every move in an exact stop.
    """

    control = "linuxcnc"
    title = "LinuxCNC"
    newline = "\n"
    decimals = 6
    closing = ("M2",)
    signals = Signals(
        begin="M65 P0\nM68 E0 Q{setup}",
        stand="M68 E0 Q{setup}\nM68 E1 Q{count}\nM64 P0",
        leave="M65 P0",
        wait="M66 E0 L0\no{count} while [#5399 NE {count}]\nG4 P0.02\nM66 E0 L0\no{count} endwhile",
        end="M68 E0 Q0",
    )
    needs = (
        (
            "hal: motion.analog-out-00 setup, motion.analog-out-01 stop counter, "
            "motion.digital-out-00 stopped"
        ),
        "hal: motion.analog-in-00 captured, only with handshake",
        "stepdiag.hal beside this program serves them over modbus",
    )

    checked = (
        (
            "G53 leaves out every offset: G54 to G59.3 with their rotation, G52, G92, the tool. "
            "G40 "
            "G49 end compensation"
        ),
        (
            "so machine and work position are not compared. it does not see a switched kinematics, "
            "M428 M429, nor rotary axes"
        ),
    )

    def file_name(self, job: Job) -> str:
        return f"step_{job.word}.ngc"

    def comment(self, text: str) -> str:
        return f"({text})"

    def start(self) -> list[str]:
        return [
            "G21 G17 G40 G49 G80 G90 G94 G61.1",
            "M5",
            *self.ask("mirror on, beam returns, way to the first stop free?"),
        ]

    def ask(self, text: str) -> list[str]:
        return [f"(MSG, {text})", "M0"]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        x, y, z = position
        return f"G53 G1 X{x} Y{y} Z{z} F{feed}"

    def dwell(self, seconds: str) -> list[str]:
        return [f"G4 P{seconds}"]


def companion_files(
    control: str, host: str = "127.0.0.1", port: int = 1502
) -> tuple[ControlFile, ...]:
    """Return the files with which LinuxCNC serves the register block at ``host`` and ``port``; none
    for a control with a PLC.

    Raises ``UsageError`` for an address that a HAL file could misread.
    """
    if control != "linuxcnc":
        return ()
    if not _ADDRESS.fullmatch(host):
        raise UsageError("plc.host", expected=message("name-or-address"), found=repr(host))
    lines = [
        (
            "# stepdiag: what a survey program says, as Modbus registers. In the INI file: [HAL] "
            "HALFILE = stepdiag.hal, after the others."
        ),
        (
            "# A pin that is netted already keeps its signal: put that signal's name in the "
            "place of "
            "the one here."
        ),
        f"loadusr -Wn stepdiag /usr/bin/python3 ./{COMPONENT} --host {host} --port {port}",
        *(
            f"net stepdiag-{pin} {theirs} {arrow} stepdiag.{pin}"
            for pin, theirs, arrow in _NETS
        ),
    ]
    source = Path(__file__).with_name(COMPONENT).read_bytes()
    return (
        ControlFile(name=COMPONENT, data=source, role="program"),
        ControlFile(name=HAL, data=ascii_lines(lines), role="program"),
    )
