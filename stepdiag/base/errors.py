"""Every refusal of the program, by cause.

    StepdiagError            never raised itself
    ├── UsageError           wrong usage, survey file or profile       (also a ValueError)
    ├── DataError            the data do not support what was asked    (also a ValueError)
    ├── DeviceError          a device cannot be reached or misbehaves  (also a ConnectionError)
    └── SafetyError          an export was refused by a safety check   (also a ValueError)

The tree stands on the lowest floor so that every floor can raise from it. Only the command line turns a
cause into an exit code.
"""

LONGEST_PART = 2000
"""Characters of each part of a refusal: a foreign file may put megabytes where a word should be."""

LONGEST_QUOTE = 60


def shortened(text: str, most: int = LONGEST_PART) -> str:
    """Return a text, or its beginning and how long it is."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def excerpt(text: str) -> str:
    """Return what of a text a message quotes: its beginning where it is long."""
    return shortened(text, LONGEST_QUOTE)


class StepdiagError(Exception):
    """A refusal that says where, what was found, what was expected and what to do; each part of bounded length.

    ``where`` names the file and the field or stop (``survey.toml: plc.poll_hz``).
    """

    def __init__(self, where: str, *, expected: str, found: str, remedy: str = "") -> None:
        where, expected, found, remedy = shortened(where), shortened(expected), shortened(found), shortened(remedy)
        self.where = where
        self.expected = expected
        self.found = found
        self.remedy = remedy
        super().__init__(f"{where}: expected {expected}, found {found}" + (f"; {remedy}" if remedy else ""))


class UsageError(StepdiagError, ValueError):
    """The command, the survey file or the profile is wrong."""


class DataError(StepdiagError, ValueError):
    """The data do not support what was asked: missing pass, broken beam, wrong sequence, damaged file."""


class DeviceError(StepdiagError, ConnectionError):
    """A device cannot be reached, or answers what it must not."""


class SafetyError(StepdiagError, ValueError):
    """An export was refused by a safety check; ``code`` names the check.

    A check that is only a warning can be accepted by that code.
    """

    def __init__(self, where: str, *, code: str, expected: str, found: str, remedy: str = "") -> None:
        super().__init__(where, expected=expected, found=found, remedy=remedy)
        self.code = code
