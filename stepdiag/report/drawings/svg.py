"""SVG as text: every text escaped, every number rounded once, so that equal input gives equal
bytes."""

from collections.abc import Iterable
from html import escape

from stepdiag.base.result.rounding import steady


def number(value: float) -> str:
    """Return a length or a coordinate as a text with at most two decimals and no trailing zeros."""
    return f"{steady(value, 2):.2f}".rstrip("0").rstrip(".")


def fixed(value: float) -> str:
    """Return a value with two decimals, the same on every processor, no negative zero."""
    return f"{steady(value, 2):.2f}"


def element(tag: str, *content: str, **attributes: str | float) -> str:
    """Return one element as markup.

    ``content`` is already markup; attribute values are escaped. ``class_`` is written ``class`` and
    an underscore in a name becomes a hyphen (``stroke_width``).
    """
    written = "".join(
        " "
        f"{name.rstrip('_').replace('_', '-')}"
        f'="{escape(value) if isinstance(value, str) else number(value)}"'
        for name, value in attributes.items()
    )
    return f"<{tag}{written}>{''.join(content)}</{tag}>" if content else f"<{tag}{written}/>"


def text(words: str, x: float, y: float, **attributes: str | float) -> str:
    """Return a text element; this function escapes ``words``."""
    return element("text", escape(words), x=x, y=y, **attributes)


def titled(words: str, tag: str, **attributes: str | float) -> str:
    """Return an invisible element that shows ``words`` at the pointer."""
    return element(tag, element("title", escape(words)), class_="titled", **attributes)


def path(points: Iterable[tuple[float, float]], *, closed: bool = False) -> str:
    """Return the ``d`` attribute of a path through pixel coordinates."""
    walked = "L".join(f"{number(x)} {number(y)}" for x, y in points)
    return f"M{walked}{'Z' if closed else ''}"


def drawing(width: float, height: float, label: str, *content: str) -> str:
    """Return a complete drawing that fills its container; ``label`` is the text for a screen
    reader."""
    return element(
        "svg",
        element("title", escape(label)),
        *content,
        viewBox=f"0 0 {number(width)} {number(height)}",
        role="img",
        class_="figure",
        xmlns="http://www.w3.org/2000/svg",
    )
