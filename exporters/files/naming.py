"""Suffixes of exported file names: warnings for people, which readers of control files ignore."""

from pathlib import PurePath

UNTESTED = "_UNTESTED_SIGN"
RESTORE = "_RESTORE"


def suffixed(name: str, suffix: str) -> str:
    path = PurePath(name)
    return f"{path.stem}{suffix}{path.suffix}"


def plain_name(name: str) -> str:
    """Return the name of a file in the control, without the suffixes of an export."""
    path = PurePath(name)
    return f"{path.stem.removesuffix(RESTORE).removesuffix(UNTESTED)}{path.suffix}"


def is_restore(name: str) -> bool:
    return PurePath(name).stem.endswith(RESTORE)
