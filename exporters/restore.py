"""The files that bring a control back to where it was."""

from collections.abc import Sequence
from dataclasses import replace

from exporters import neutral
from exporters.controller import Controller
from exporters.naming import RESTORE, suffixed
from exporters.profile import Profile
from exporters.tables import ControlFile, Table, zeroed


def restore_files(controller: Controller, tables: Sequence[Table], profile: Profile) -> list[ControlFile]:
    """Return the machine's own files byte for byte, or ``tables`` as zeros where it had none; curves for people need neither.

    ``profile`` carries the choices that the planning of the tables made.
    """
    if controller.name == neutral.NAME:
        return []
    files = profile.existing or controller.render(zeroed(tables), profile, ["RESTORE: all values zero"])
    return [replace(file, name=suffixed(file.name, RESTORE)) for file in files if file.role != "note"]
