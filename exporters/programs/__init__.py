"""NC programs that drive a survey: one program for each setup, in the dialect of the control.

    Sequence --passes_of--> passes of stops --dialect--> NC program

A program is a list of blocks without loops, subprograms and calculated positions, so that a person
can read and search every move. The program sends the numbers of setup and stop to the PLC, which
writes them into its Modbus registers.
"""

from stepdiag.exporters.programs.linuxcnc import companion_files
from stepdiag.exporters.programs.programs import (
    CONTROLS,
    Program,
    default_decimals,
    default_signals,
    nc_programs,
    program_name,
)
from stepdiag.exporters.programs.sequence import Pass, Sequence, Stop, passes_of
from stepdiag.exporters.programs.signals import Signals

__all__ = [
    "CONTROLS",
    "Pass",
    "Program",
    "Sequence",
    "Signals",
    "Stop",
    "companion_files",
    "default_decimals",
    "default_signals",
    "nc_programs",
    "passes_of",
    "program_name",
]
