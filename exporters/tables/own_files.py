"""Restore files of a control whose tables are lists: the machine's own files, and zeros for tables
that these files lack.
"""

from collections.abc import Callable, Hashable, Sequence

from stepdiag.exporters.files.control_file import ControlFile, without_notes
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, zeroed

NO_TABLE_BEFORE = "RESTORE: no table before, so all values zero"


def lacking(
    controller: Controller,
    tables: Sequence[Table],
    profile: Profile,
    place: Callable[[Table], Hashable],
) -> tuple[Table, ...]:
    """Return a table of zeros for each of the ``tables`` whose ``place`` the machine's own files do
    not contain.
    """
    held = (
        {place(table) for table in controller.parse(profile.existing, profile)}
        if profile.existing
        else set()
    )
    return tuple(table for table in zeroed(tables) if place(table) not in held)


def own_and_zeros(
    controller: Controller,
    tables: Sequence[Table],
    profile: Profile,
    place: Callable[[Table], Hashable],
) -> tuple[ControlFile, ...]:
    """Return the machine's own files, and files of zeros for ``tables`` that these files do not
    contain at the same ``place``.
    """
    zeros = lacking(controller, tables, profile, place)
    rendered = controller.render(zeros, profile, (NO_TABLE_BEFORE,)) if zeros else ()
    return (*profile.existing, *without_notes(rendered))
