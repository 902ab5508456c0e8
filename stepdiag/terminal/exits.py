"""Errors and exit codes of a command. Only this module maps the cause of an error to an exit code
(contract 5)."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from stepdiag.base.errors import (
    DataError,
    DeviceError,
    SafetyError,
    StepdiagError,
    UsageError,
    system_words,
)
from stepdiag.base.messages import Words, message
from stepdiag.terminal.printable import micro_shown, printable
from stepdiag.terminal.viewer import shown

EXIT_CODES: dict[type[StepdiagError], int] = {
    UsageError: 2,
    DataError: 3,
    DeviceError: 4,
    SafetyError: 5,
}
INTERRUPTED = 130


@contextmanager
def refusals_shown(written: Callable[[Words], str] = shown) -> Iterator[None]:
    """Write an error to standard error in the form of ``written``, and exit with the code of its
    cause."""
    micro_shown()
    try:
        yield
    except StepdiagError as error:
        refusal = error.message
        if isinstance(error, SafetyError):
            refusal = message("refusal-with-code", refusal=refusal, code=error.code)
        sys.stderr.write(printable(written(message("by-program", what=refusal))) + "\n")
        sys.exit(next(code for cause, code in EXIT_CODES.items() if isinstance(error, cause)))
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


@contextmanager
def failed_writing_shown() -> Iterator[None]:
    """Convert an error of the operating system into an error message: a full disk, a missing
    permission, a character that the terminal cannot show.

    The daemon does not use this context manager: an error of the operating system during a
    recording can be temporary, and is then not a usage error.
    """
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        _close_output()
        sys.exit(0)  # the program that reads the output has ended
    except UnicodeEncodeError as error:
        _close_output()
        letters = error.object[error.start : error.end]
        raise UsageError(
            message("the-terminal"),
            expected=message("encoding-with", letters=ascii(letters[:20])),
            found=error.encoding,
            remedy=message("set-utf-8"),
        ) from error
    except OSError as error:
        if isinstance(error, StepdiagError):
            raise
        if error.filename is None:
            _close_output()
        raise UsageError(
            str(error.filename) if error.filename else message("the-output"),
            expected=message("readable-and-writable"),
            found=system_words(error),
        ) from error


def _close_output() -> None:
    """Discard the rest of the output of the command, so that closing standard output raises no
    further error.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
