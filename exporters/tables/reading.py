from collections.abc import Sequence

from stepdiag.base.errors import DataError
from stepdiag.base.messages import message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def tables_in(
    controller: Controller, files: Sequence[ControlFile], profile: Profile
) -> tuple[Table, ...]:
    """Return the tables that the control reads from files. Raises ``DataError`` for a table that is
    in two files, such as a file and its copy, because its effect would be doubled.
    """
    tables = controller.parse(files, profile)
    seen: set[object] = set()
    for table in tables:
        if table.identity in seen:
            raise DataError(
                ", ".join(file.name for file in files),
                expected=message("one-table", label=table.label),
                found=message("count-twice"),
                remedy=message("every-file-once"),
            )
        seen.add(table.identity)
    return tables
