from collections.abc import Sequence
from dataclasses import replace

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import RESTORE, suffixed
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table


def restore_files(
    controller: Controller, tables: Sequence[Table], profile: Profile
) -> list[ControlFile]:
    """Return the controller's files that remove ``tables`` and restore the old tables, as
    ``<name>_RESTORE``.
    """
    return [
        replace(file, name=suffixed(file.name, RESTORE))
        for file in controller.restore(tables, profile)
    ]
