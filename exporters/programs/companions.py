"""What has to run on a control beside the programs of a survey, where it has no PLC to be asked: LinuxCNC's HAL component."""

import re
from pathlib import Path

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.listing import ascii_lines
from stepdiag.solver.errors import UsageError

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


def companion_files(control: str, host: str = "127.0.0.1", port: int = 1502) -> tuple[ControlFile, ...]:
    """Return the files that LinuxCNC runs to serve the register block at ``host`` and ``port``; none for a control with a PLC.

    Raises ``UsageError`` for an address that could be taken for anything else in a HAL file.
    """
    if control != "linuxcnc":
        return ()
    if not _ADDRESS.fullmatch(host):
        raise UsageError("plc.host", expected="a name or an address", found=repr(host))
    lines = [
        "# stepdiag: what a survey program says, as Modbus registers. In the INI file: [HAL] HALFILE = stepdiag.hal, after the others.",
        "# A pin that is netted already keeps its signal: put that signal's name in the place of the one here.",
        f"loadusr -Wn stepdiag /usr/bin/python3 ./{COMPONENT} --host {host} --port {port}",
        *(f"net stepdiag-{pin} {theirs} {arrow} stepdiag.{pin}" for pin, theirs, arrow in _NETS),
    ]
    source = Path(__file__).with_name(COMPONENT).read_bytes()
    return (ControlFile(name=COMPONENT, data=source, role="program"), ControlFile(name=HAL, data=ascii_lines(lines), role="program"))
