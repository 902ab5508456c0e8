"""What is in a control after files have been loaded over others: what has the same seat is overwritten, the rest stays as it was."""

from collections.abc import Callable, Hashable, Iterable, Sequence

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import plain_name
from stepdiag.exporters.tables.tables import Table


def overwritten(own: Iterable[Table], new: Sequence[Table], seat: Callable[[Table], Hashable]) -> tuple[Table, ...]:
    """Return the tables of a control that keeps one for each ``seat`` (or one set of them): the new ones, and old ones of other seats."""
    taken = {seat(table) for table in new}
    return (*(table for table in own if seat(table) not in taken), *new)


def copied(own: Iterable[ControlFile], new: Iterable[ControlFile]) -> tuple[ControlFile, ...]:
    """Return the files of a folder after ``new`` were copied over ``own``: the later of each name, suffixes of exports aside."""
    held = {plain_name(file.name).upper(): file for file in own}
    return tuple({**held, **{plain_name(file.name).upper(): file for file in new}}.values())
