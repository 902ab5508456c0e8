"""Every refusal of the program, by cause.

    StepdiagError            never raised itself
    ├── UsageError           wrong usage, survey file or profile       (also a ValueError)
    ├── DataError            the data do not support what was asked    (also a ValueError)
    ├── DeviceError          a device cannot be reached or misbehaves  (also a ConnectionError)
    └── SafetyError          an export was refused by a safety check   (also a ValueError)

The tree is on the lowest floor so that every floor can raise from it. Only the command line turns a
cause into an exit code.
"""

import errno
import os
from typing import cast

from stepdiag.base.messages import Message, Words, message, message_of


class StepdiagError(Exception):
    """An error message: place, expected value, value found and remedy; each a message, a name or a
    value.

    ``where`` names the file and the field or stop (``survey.toml: plc.poll_hz``). ``message`` is
    the whole; the text of the exception is its English form.
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
    """The data do not support the request: missing pass, broken beam, wrong sequence, damaged
    file.
    """


class DeviceError(StepdiagError, ConnectionError):
    """A device cannot be reached, or gives an invalid answer."""


class SafetyError(StepdiagError, ValueError):
    """An export was refused by a safety check; ``code`` names the check: a code of
    docs/findings.md, or code and variant.

    A check that only warns can be accepted by its code.
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
    """Return the refusal of the operating system, by its number: a message for common refusals,
    else the system's own words.
    """
    code = error if isinstance(error, int) else getattr(error, "errno", None)
    if code is None:
        return str(error)
    return _of_the_system(code) or (
        os.strerror(code)
        if isinstance(error, int)
        else getattr(error, "strerror", None) or str(error)
    )
