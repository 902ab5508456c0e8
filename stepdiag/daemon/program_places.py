"""The folders of this program on the disk, and the systemd unit that can read only these folders.

pyenv and uv install Python in the home of a user, which the unit otherwise cannot read. A virtual
environment refers to its Python by links. Every folder with such a link must be visible in the
unit.
"""

import os
import re
import sys
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

PACKAGED = "/opt/stepdiag"
"""Folder of the program in the packaged unit."""
SYSTEM = Path("/usr")
"""Folder of the operating system, which the unit can always read."""
HOMES = (Path("/home"), Path("/root"), Path("/run/user"))
"""Folders that ProtectHome=yes hides (systemd.exec(5)), even if they are bound into the unit."""
OTHERS_READ = 0o005
LINKS = 40
"""Largest number of links that are followed one after another; a kernel follows fewer."""


def places_of_program() -> list[Path]:
    """Return the folders of the environment, of its Python and of the package. A folder inside
    another returned folder is left out, and so are the folders of the operating system."""
    found = [
        Path(sys.prefix),
        Path(sys.base_prefix),
        Path(str(files("stepdiag"))).parent,
        *_homes_of(Path(sys.executable)),
    ]
    every = sorted(
        {place for each in found for place in (each, each.resolve()) if _is_own(place)}
    )
    return [place for place in every if not set(place.parents) & set(every)]


def at_its_places(unit: str, places: list[Path], *, reachable: bool = True) -> str:
    """Return the packaged unit, changed for a program in these folders. Raises UsageError for a
    program that the account of the service cannot run."""
    for place in places:
        _assert_plain(place)
        _assert_no_home(place)
        if reachable:
            _assert_read_by_all(place)
    bound = f"BindReadOnlyPaths={' '.join(map(str, places))}"
    unit = unit.replace(f"BindReadOnlyPaths={PACKAGED}", bound).replace(
        f"{PACKAGED}/bin", f"{sys.prefix}/bin"
    )
    if any(set(place.parents) & set(HOMES) for place in places):
        # The value yes would also hide the bound folders of the program in a home.
        unit = unit.replace("ProtectHome=yes", "ProtectHome=tmpfs")
    return unit


def _is_own(place: Path) -> bool:
    return SYSTEM not in (place, *place.parents) and place != place.parent


def _homes_of(executable: Path) -> Iterator[Path]:
    for _ in range(LINKS):
        if not executable.is_symlink():
            yield executable.parent.parent
            return
        yield executable.parent
        executable = Path(
            os.path.normpath(executable.parent.resolve() / executable.readlink())
        )


def _assert_plain(place: Path) -> None:
    if not re.fullmatch(r"[\w./@+-]+", str(place), re.ASCII):
        raise UsageError(
            message("programs-place"),
            expected=message("letters-and", signs="./@+-_"),
            found=repr(str(place)),
            remedy=message("install-to-opt"),
        )


def _assert_no_home(place: Path) -> None:
    """Refuse a folder directly in a home: a link to a Python in this folder would open the whole
    home to the service."""
    if (
        place == Path("/root")
        or place.parent == Path("/home")
        or place.parent == Path("/run/user")
        or place in HOMES
    ):
        raise UsageError(
            message("programs-place"),
            expected=message("folder-of-its-own"),
            found=str(place),
            remedy=message("install-with-python"),
        )


def _assert_read_by_all(place: Path) -> None:
    """Refuse a folder that not every account can read, because the service has its own account. The
    rights of the parent folders have no effect, because the service enters the bound folder
    directly."""
    place = place.resolve()  # not every chmod command follows a link
    closed = next(
        (
            each
            for each in (
                place,
                *sorted(place.glob("bin")),
                *sorted(place.glob("bin/python*")),
            )
            if not _read_by_all(each)
        ),
        None,
    )
    if closed is not None:
        raise UsageError(
            str(closed),
            expected=message("readable-by-service"),
            found=message("closed-to-others"),
            remedy=message("open-to-others", place=str(place)),
        )


def _read_by_all(place: Path) -> bool:
    return place.stat().st_mode & OTHERS_READ == OTHERS_READ
