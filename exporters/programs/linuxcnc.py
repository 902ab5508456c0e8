"""LinuxCNC: RS274/NGC program, metric."""

from stepdiag.exporters.programs.dialect import Dialect, Job
from stepdiag.exporters.programs.signals import Signals


class LinuxCNC(Dialect):
    """RS274/NGC in machine coordinates (``G53`` with each move).

    ``M64``, ``M65`` and ``M68`` are carried out when the moves before them have ended; ``G61.1`` ends every move in an exact stop.
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
        "hal: motion.analog-out-00 setup, motion.analog-out-01 stop counter, motion.digital-out-00 stopped",
        "hal: motion.analog-in-00 captured, only with handshake",
        "stepdiag.hal beside this program serves them over modbus",
    )

    def file_name(self, job: Job) -> str:
        """Return the name of the program."""
        return f"step_{job.word}.ngc"

    def comment(self, text: str) -> str:
        """Return a comment block."""
        return f"({text})"

    def start(self) -> list[str]:
        """Return known modes and the halt with its question on the screen."""
        return [
            "G21 G17 G40 G49 G80 G90 G94 G61.1",
            "M5",
            "(MSG, mirror on, beam returns, way to the first stop free?)",
            "M0",
        ]

    def move(self, position: tuple[str, str, str], feed: str) -> str:
        """Return a move without any offset."""
        x, y, z = position
        return f"G53 G1 X{x} Y{y} Z{z} F{feed}"

    def dwell(self, seconds: str) -> list[str]:
        """Return the dwell in seconds."""
        return [f"G4 P{seconds}"]
