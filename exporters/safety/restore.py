"""The files that bring a control back to where it was."""

from collections.abc import Sequence
from dataclasses import replace

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.files.naming import RESTORE, suffixed
from stepdiag.exporters.neutral import curves_csv
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Table, zeroed


def restore_files(controller: Controller, tables: Sequence[Table], profile: Profile) -> list[ControlFile]:
    """Return the machine's own files byte for byte, or ``tables`` as zeros where it had none; curves for people need neither.

    ``profile`` carries the choices that the planning of the tables made.
    """
    if controller.name == curves_csv.NAME:
        return []
    files = profile.existing or controller.render(zeroed(tables), profile, ["RESTORE: all values zero"])
    return [replace(file, name=suffixed(file.name, RESTORE)) for file in files if file.role != "note"]
