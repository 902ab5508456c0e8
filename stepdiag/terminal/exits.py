"""The only place where a cause becomes an exit code (contract 5)."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from stepdiag.solver.errors import DataError, DeviceError, SafetyError, StepdiagError, UsageError
from stepdiag.terminal.printable import printable

EXIT_CODES: dict[type[StepdiagError], int] = {UsageError: 2, DataError: 3, DeviceError: 4, SafetyError: 5}
INTERRUPTED = 130


@contextmanager
def refusals_said() -> Iterator[None]:
    """Say a refusal on standard error and leave with the exit code of its cause."""
    try:
        yield
    except StepdiagError as error:
        code = f" [{error.code}]" if isinstance(error, SafetyError) else ""
        sys.stderr.write(printable(f"stepdiag: {error}{code}") + "\n")
        sys.exit(next(code for cause, code in EXIT_CODES.items() if isinstance(error, cause)))
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
