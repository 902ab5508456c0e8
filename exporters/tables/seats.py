"""The tables of a control after loading: a new table overwrites the old table in the same place,
and all other old tables stay.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.tables.tables import Table


def overwritten(
    own: Iterable[Table], new: Sequence[Table], seat: Callable[[Table], Hashable]
) -> tuple[Table, ...]:
    """Return the tables of a control after loading: the new tables, and the old tables of every
    ``seat`` (place in the control) that no new table has.
    """
    taken = {seat(table) for table in new}
    return (*(table for table in own if seat(table) not in taken), *new)


def copied(own: Iterable[ControlFile], new: Iterable[ControlFile]) -> tuple[ControlFile, ...]:
    """Return the files of a folder after the files ``new`` were copied over ``own``. Of two files
    with the same name (without the suffixes of exports), the later file counts.
    """
    held = {plain_name(file.name).upper(): file for file in own}
    return tuple({**held, **{plain_name(file.name).upper(): file for file in new}}.values())
