"""The errors of the program by cause.

    StepdiagError            never raised itself
    ├── UsageError           wrong usage, survey file or profile       (also a ValueError)
    ├── DataError            the data do not support what was asked    (also a ValueError)
    ├── DeviceError          a device cannot be reached or misbehaves  (also a ConnectionError)
    └── SafetyError          an export was refused by a safety check   (also a ValueError)

The exceptions are on the lowest floor, so every floor can raise them. Only the command line maps a
cause to an exit code.
"""

import errno
import os
from typing import cast

from stepdiag.base.messages import Message, Words, message, message_of


class StepdiagError(Exception):
    """An error message in four parts: place, expected value, found value, remedy.

    ``where`` contains the file and the field or stop (``survey.toml: plc.poll_hz``). ``message``
    contains all four parts; the text of the exception is its English form.
    """

    def __init__(
        self, where: Words, *, expected: Words, found: Words, remedy: Words = ""
    ) -> None:
        parts = {"where": where, "expected": expected, "found": found}
        self.message = (
            message("refusal-with-remedy", remedy=remedy, **parts)
            if remedy
            else message("refusal", **parts)
        )
        bounded = cast("dict[str, Words]", self.message.arguments)
        self.where, self.expected, self.found, self.remedy = (
            bounded.get(name, "") for name in ("where", "expected", "found", "remedy")
        )
        super().__init__(str(self.message))


class UsageError(StepdiagError, ValueError):
    """The command, the survey file or the profile is wrong."""


class DataError(StepdiagError, ValueError):
    """The data do not support the request. Examples: a missing pass, a broken beam, a damaged
    file."""


class DeviceError(StepdiagError, ConnectionError):
    """A device cannot be reached, or its answer is invalid."""


class SafetyError(StepdiagError, ValueError):
    """A safety check refused an export. ``code`` is the key of the check in docs/findings.md.

    A person can accept a warning of a safety check by this code.
    """

    def __init__(
        self, where: Words, *, code: str, expected: Words, found: Words, remedy: Words = ""
    ) -> None:
        super().__init__(where, expected=expected, found=found, remedy=remedy)
        self.code = code


def _of_the_system(code: int) -> Message | None:
    return message_of(
        {"key": f"os-{errno.errorcode.get(code, 'E')[1:].lower()}", "arguments": {}}
    )


def system_words(error: Exception | int) -> Words:
    """Return the message for an error number of the operating system; for a rare number the text of
    the operating system."""
    code = error if isinstance(error, int) else getattr(error, "errno", None)
    if code is None:
        return str(error)
    return _of_the_system(code) or (
        os.strerror(code)
        if isinstance(error, int)
        else getattr(error, "strerror", None) or str(error)
    )
