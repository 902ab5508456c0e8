"""The contents of a control after files have been loaded over others: a table in the same place is
overwritten, the others stay.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.tables.tables import Table


def overwritten(
    own: Iterable[Table], new: Sequence[Table], seat: Callable[[Table], Hashable]
) -> tuple[Table, ...]:
    """Return the tables of a control with a table (or a set) per ``seat``: the new tables, and old
    tables of other seats.
    """
    taken = {seat(table) for table in new}
    return (*(table for table in own if seat(table) not in taken), *new)


def copied(own: Iterable[ControlFile], new: Iterable[ControlFile]) -> tuple[ControlFile, ...]:
    """Return the files of a folder after ``new`` were copied over ``own``: the later of each name,
    without the suffixes of exports.
    """
    held = {plain_name(file.name).upper(): file for file in own}
    return tuple({**held, **{plain_name(file.name).upper(): file for file in new}}.values())
