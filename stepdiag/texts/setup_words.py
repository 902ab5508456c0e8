"""The names of setups for people: a diagonal has its two corners, followed by its short name."""

from stepdiag.texts.texts import Language

_KINDS: dict[str, dict[Language, str]] = {
    "step": {"en": "diagonal", "de": "Diagonale"},
    "face": {"en": "face diagonal", "de": "Flächendiagonale"},
    "body": {"en": "continuous diagonal", "de": "durchgehende Diagonale"},
    "linear": {"en": "linear run", "de": "Linearlauf"},
    "fourdof": {"en": "4-DOF run", "de": "4-DOF-Lauf"},
}
_TO: dict[Language, str] = {"en": "to", "de": "nach"}


def setup_words(name: str, language: Language) -> str:
    """Return ``diagonal X+Y-Z- to X-Y+Z+ (npp)`` for the name of a setup; any other text unchanged.

    The sign behind an axis is the end of its travel at which the outward pass begins or ends.
    """
    kind, _, rest = name.partition("+")[0].rpartition("-")
    if kind in ("linear", "fourdof") and rest in ("x", "y", "z"):
        return f"{_KINDS[kind][language]} {rest.upper()} ({name})"
    kind, _, plane = kind.partition("-")
    axes = plane.upper() or "XYZ"
    if len(rest) != len(axes) or set(rest) - {"p", "n"} or kind not in ("", "face", "body"):
        return name
    begin, end = (
        "".join(map("".join, zip(axes, signs, strict=True))) for signs in _ends(rest)
    )
    return f"{_KINDS[kind or 'step'][language]} {begin} {_TO[language]} {end} ({name})"


def _ends(letters: str) -> tuple[list[str], list[str]]:
    rises = [letter == "p" for letter in letters]
    return ["-" if up else "+" for up in rises], ["+" if up else "-" for up in rises]
