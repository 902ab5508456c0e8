"""The texts by which a program sends setup, stop and standstill to the PLC.

Free outputs, data words and M functions depend on the machine. The defaults are the simplest means
of each control. For a machine that needs other signals, the profile contains texts with
placeholders.
"""

import string
from dataclasses import dataclass, fields

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import excerpt, message

LONGEST_TEXT = 1000
PLACEHOLDERS = {
    "begin": {"setup"},
    "stand": {"setup", "count"},
    "leave": {"setup", "count"},
    "wait": {"setup", "count"},
    "end": set[str](),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """The texts of the blocks that send signals to the PLC. Each block is a line; an empty text
    sends nothing.

    ``begin`` sends the setup number at the start, and sets ``stopped`` off, because an aborted
    program may have left it on. ``stand`` sends the new stop count and sets ``stopped`` on while
    the machine dwells in position. ``leave`` sets ``stopped`` off before the next move. ``wait``,
    used only with the handshake, waits until the PLC shows ``captured`` equal to the stop count.
    ``end`` sends setup number 0. Placeholders ``{setup}`` and ``{count}`` are whole numbers.
    """

    begin: str
    stand: str
    leave: str
    wait: str
    end: str

    def __post_init__(self) -> None:
        for item in fields(self):
            known = PLACEHOLDERS[item.name]
            _refuse_unprintable(f"program.{item.name}", getattr(self, item.name))
            for name in _placeholders(f"program.{item.name}", getattr(self, item.name)):
                if name not in known:
                    raise UsageError(
                        f"program.{item.name}",
                        expected="only "
                        + " and ".join(f"{{{each}}}" for each in sorted(known))
                        if known
                        else message("no-placeholder"),
                        found=f"{{{name}}}",
                    )

    def blocks(self, which: str, *, setup: int, count: int = 0) -> list[str]:
        """Return the blocks of one field, with numbers instead of placeholders."""
        text: str = getattr(self, which)
        return text.format(setup=setup, count=count).splitlines()


def _placeholders(where: str, text: str) -> list[str]:
    expected = message("text-with", names=["{setup}", "{count}"])
    try:
        found = [
            (name, spec, conversion)
            for _, name, spec, conversion in string.Formatter().parse(text)
            if name is not None
        ]
    except ValueError as error:
        raise UsageError(where, expected=expected, found=f"{text!r}: {error}") from error
    for name, spec, conversion in found:
        if spec or conversion:  # a format may ask for a width of millions of digits
            raise UsageError(
                where,
                expected=expected,
                found=message("own-form", name=f"{{{name}}}"),
                remedy=message("leave-out-what-follows"),
            )
    return [name for name, _, _ in found]


def _refuse_unprintable(where: str, text: str) -> None:
    if len(text) > LONGEST_TEXT or any(
        letter != "\n" and not (letter.isascii() and letter.isprintable()) for letter in text
    ):
        expected = message("printable-ascii-characters-and", longest_text=LONGEST_TEXT)
        raise UsageError(where, expected=expected, found=repr(excerpt(text)))
