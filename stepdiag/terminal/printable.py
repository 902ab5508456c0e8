"""Text that a terminal can show: without control characters from foreign files, and with ``um`` for
a missing micrometre sign."""

import codecs
import sys
from collections.abc import Callable
from io import TextIOWrapper


def printable(text: str) -> str:
    """Return a text without the characters that control a terminal; line ends stay."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "?" for letter in text
    )


class _PlainStream(TextIOWrapper):
    """A stream whose encoding lacks the sign µ. The attribute ``encoding`` is not "ascii", because
    typer writes UTF-8 directly to a stream with the encoding "ascii"."""

    encoding = "plain, um for micrometre"


def micro_shown() -> None:
    """Write ``um`` for µm on standard output and error if their encoding lacks the sign, for
    example ASCII or ISO 8859-2.

    With ASCII, other characters are written as UTF-8 without loss; with another encoding they are
    written as before.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if (
            not isinstance(stream, TextIOWrapper)
            or isinstance(stream, _PlainStream)
            or _has_micro(stream.encoding)
        ):
            continue
        codecs.register_error(f"micro-{name}", _with_u(stream.errors or "strict"))
        encoding, buffered = stream.encoding, stream.line_buffering
        setattr(
            sys,
            name,
            _PlainStream(stream.detach(), encoding, f"micro-{name}", line_buffering=buffered),
        )


def _has_micro(encoding: str) -> bool:
    try:
        "µ".encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _with_u(errors: str) -> Callable[[UnicodeError], tuple[str | bytes, int]]:
    otherwise = codecs.lookup_error(errors)

    def handled(error: UnicodeError) -> tuple[str | bytes, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        letters = error.object[error.start : error.end].replace("µ", "u")
        if codecs.lookup(error.encoding).name == "ascii":
            return letters.encode(), error.end
        return (letters, error.end) if letters.isascii() else otherwise(error)

    return handled
