"""Warnings in the names of exported files, which people read and the readers of control files
ignore.
"""

from pathlib import PurePath

UNTESTED = "_UNTESTED_SIGN"
RESTORE = "_RESTORE"


def suffixed(name: str, suffix: str) -> str:
    """Return a file name with ``suffix`` before its ending."""
    path = PurePath(name)
    return f"{path.stem}{suffix}{path.suffix}"


def plain_name(name: str) -> str:
    """Return the name of a file in the control: the name without the suffixes of an export."""
    path = PurePath(name)
    return f"{path.stem.removesuffix(RESTORE).removesuffix(UNTESTED)}{path.suffix}"


def is_restore(name: str) -> bool:
    """Return whether the file with this name restores the earlier state of the control."""
    return PurePath(name).stem.endswith(RESTORE)
