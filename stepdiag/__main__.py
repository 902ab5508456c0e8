"""The entry point of ``stepdiag`` and ``python -m stepdiag``.

The daemon started by systemd (``run FILE``) does not import the libraries of the command line: they
would take a third of its start time and an eighth of its memory.
"""

import os
import sys
from pathlib import Path


def main() -> None:
    """Run the daemon, or any other command of the command line.

    numpy uses one thread, because the solver's matrices are small: several threads need seven times
    the processor time. With one thread, numpy also adds numbers in a fixed order, so a sum is the
    same on every computer.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from stepdiag.base.disk.system import LINUX

    match sys.argv[1:]:
        case ["run", file] if LINUX and not file.startswith("-"):
            from stepdiag.daemon.service import record
            from stepdiag.terminal.exits import refusals_shown

            with refusals_shown():
                record(Path(file))
        case _:
            from stepdiag.cli.app import main as command_line

            command_line()


if __name__ == "__main__":
    main()
