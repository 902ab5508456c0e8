"""One zip a set, with the files' own names, so that its SHA256SUMS holds."""

import hashlib
import io
import zipfile
from datetime import date
from pathlib import Path

from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.sets import zip_of
from testkit.exact.madeup import made_up_result


def unpacked(data: bytes) -> dict[str, bytes]:
    """Return the files of a zip."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_load_and_restore_are_apart_and_their_sums_hold(tmp_path: Path) -> None:
    """Nobody loads a restore file by unpacking everything; together both hold the whole folder."""
    folder = tmp_path / "exports" / "siemens"
    written = export(
        made_up_result(scales=True),
        "siemens",
        None,
        step_mm=25.0,
        out_dir=folder,
        today=date(2026, 1, 1),
    )
    load, restore = (unpacked(zip_of(folder, restore=each)) for each in (False, True))
    assert restore.keys() - {"SHA256SUMS"} == {
        name for name in written.files if "_RESTORE" in name
    }
    assert load.keys() | restore.keys() == set(written.files)
    for files in (load, restore):
        listed = dict(
            line.split("  ")[::-1] for line in files["SHA256SUMS"].decode().splitlines()
        )
        assert listed == {
            name: hashlib.sha256(data).hexdigest()
            for name, data in files.items()
            if name != "SHA256SUMS"
        }
    assert zip_of(folder, restore=False) == zip_of(folder, restore=False)
