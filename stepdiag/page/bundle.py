"""What belongs together for one control as one zip: the files under their own names, with a SHA256SUMS that holds for what is in it."""

import io
import zipfile
from pathlib import Path

from stepdiag.exporters.files.naming import is_restore
from stepdiag.exporters.files.sets import SUMS

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The oldest date that a zip can hold: the same files give the same bytes."""


def bundle_of(folder: Path, *, restore: bool) -> bytes:
    """Return the zip of an export's folder: its files without those that restore the control, or these alone."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file() and path.name != SUMS and is_restore(path.name) == restore]
    listed = (folder / SUMS).read_text(encoding="ascii").splitlines() if (folder / SUMS).is_file() else []
    kept = {path.name for path in files}
    sums = "".join(f"{line}\n" for line in listed if line.partition("  ")[2] in kept)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in [*((path.name, path.read_bytes()) for path in files), (SUMS, sums.encode("ascii"))]:
            archive.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
