"""What belongs together for one control as one zip: the files under their own names, with a SHA256SUMS that holds for what is in it."""

import io
import zipfile
from pathlib import Path

from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.files.sets import SUMS, read_set, sums_of

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The oldest date that a zip can hold: the same files give the same bytes."""


def bundle_of(folder: Path, *, restore: bool) -> bytes:
    """Return the zip of an export's folder: its files without those that restore the control, or these alone.

    What is packed is what was compared with the list: a set that is altered while somebody fetches it is refused, with the SafetyError of
    `read_set`.
    """
    files = [file for file in read_set(folder) if file.name != SUMS and is_restore(file.name) == restore]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in (*sorted(files, key=lambda file: file.name), sums_of(files)):
            archive.writestr(zipfile.ZipInfo(file.name, EPOCH), file.data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
